"""What a newcomer reads while `make demo` sets up: a line a step, or one line where the
system will not do."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
PYTHON = """#!/bin/sh
case "$1" in
  -)
    exec {python} -c 'import platform, sys; {other}
sys.argv = sys.argv[1:]
exec(sys.stdin.read())' "$@" ;;
  -m)
    i=0
    while [ $i -lt 185 ]; do echo "WARNING: $i" >&2; i=$((i + 1)); done
    echo "{said}"
    exit {code} ;;
esac
"""


def install(
    folder: Path, *, other: str = "pass", said: str = "", code: int = 0
) -> "subprocess.CompletedProcess[str]":
    """Run `scripts/install demo` with a Python that says it is another, and whose pip
    warns as real ones do."""
    for name, text in {
        "venv/bin/python": PYTHON.format(
            python=sys.executable, other=other, said=said, code=code
        ),
        "bin/dpkg-query": "#!/bin/sh\necho install ok installed\n",
        "bin/apt-cache": "#!/bin/sh\n",
        **{
            f"bin/{each}": f"#!/bin/sh\ntouch {folder}/downloaded\n"
            for each in ("apt-get", "curl", "npm", "sudo", "wget")
        },
    }.items():
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text)
        path.chmod(0o755)
    environment = {
        **os.environ,
        "PATH": f"{folder / 'bin'}{os.pathsep}{os.environ['PATH']}",
    }
    command = [ROOT / "scripts" / "install", "demo", folder / "venv"]
    return subprocess.run(
        command,
        env=environment,
        capture_output=True,
        text=True,
        timeout=60,
        check=False,
    )


@pytest.mark.parametrize(
    ("other", "named"),
    [
        ('sys.platform = "darwin"; platform.system = lambda: "Darwin"', "Darwin"),
        (
            'sys.version_info = (3, 10); platform.python_version = lambda: "3.10.13"',
            "3.10.13",
        ),
        (
            'sys.version_info = (3, 15); platform.python_version = lambda: "3.15.0"',
            "3.15.0",
        ),
        ('platform.python_implementation = lambda: "PyPy"', "PyPy"),
        ('platform.libc_ver = lambda: ("", "")', "Linux"),
        ('platform.machine = lambda: "armv7l"', "armv7l"),
    ],
)
def test_a_system_that_will_not_do_is_told_so_in_a_line_before_any_download(
    tmp_path: Path, other: str, named: str
) -> None:
    done = install(tmp_path, other=other, said="pip was run")
    (line,) = done.stderr.splitlines()
    assert (done.returncode, done.stdout) == (1, "")
    assert line.startswith(
        "make demo needs CPython 3.11 to 3.14 on 64-bit Linux with glibc; this is "
    )
    assert named in line
    assert "docs/guide/installation.md" in line
    assert not (tmp_path / "downloaded").exists()


def test_a_step_is_a_line_however_much_pip_warns(tmp_path: Path) -> None:
    done = install(tmp_path)
    first, packages, last = done.stdout.splitlines()
    assert (first, last) == ("system packages", "tactophone")
    assert packages.endswith("Python packages of requirements/demo.txt")
    assert (done.returncode, done.stderr) == (0, "")
    assert (tmp_path / "venv" / ".demo").exists()


def test_a_step_that_fails_shows_what_it_said(tmp_path: Path) -> None:
    done = install(tmp_path, said="no route to the index", code=1)
    assert done.returncode == 1
    *_, said, failed = done.stderr.splitlines()
    assert said == "no route to the index"
    assert failed.startswith("failed: pip install --require-hashes")
    assert not (tmp_path / "venv" / ".demo").exists()


@pytest.mark.parametrize(
    ("unknown", "code", "said"),
    [
        ("tshark", 0, "no tshark or GStreamer in this system's packages"),
        ("coturn", 1, "apt does not know coturn"),
    ],
)
def test_a_system_without_other_peoples_tools_only_skips_their_tests(
    tmp_path: Path, unknown: str, code: int, said: str
) -> None:
    query = f'case "$*" in *{unknown}*) exit 1 ;; esac\necho install ok installed'
    for name, text in {
        "dpkg-query": query,
        "apt-cache": "exit 0",
        "apt-get": "exit 0",
        "sudo": '"$@"',
    }.items():
        path = tmp_path / name
        path.write_text(f"#!/bin/sh\n{text}\n")
        path.chmod(0o755)
    done = subprocess.run(
        [ROOT / "scripts" / "system-packages", "test"],
        env={**os.environ, "PATH": f"{tmp_path}{os.pathsep}{os.environ['PATH']}"},
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == code
    assert said in done.stdout + done.stderr


def test_without_a_name_the_system_packages_ask_for_one() -> None:
    """It once ended without a word, and had installed nothing."""
    done = subprocess.run(
        [ROOT / "scripts" / "system-packages"],
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 2
    assert "libopus0" in done.stderr
