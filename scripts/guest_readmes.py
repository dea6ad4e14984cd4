"""Follow each README in integrations/ in a fresh environment: install what it says,
load the package's entry points, and run its commands as written.

    python scripts/guest_readmes.py [PACKAGE ...]

Left out, and named, are commands with placeholders and those of other programs, such as
``lerobot-record``, which need a robot.
"""

import argparse
import re
import subprocess
import sys
import tempfile
import venv
from pathlib import Path

ROOT = Path(__file__).parents[1]

HEAVY = ("lerobot_camera_tactophone", "lerobot_robot_tactophone")
"""These bring torch, several gigabytes; they are followed where they are named."""

LOAD = """
import importlib, importlib.metadata, sys
importlib.import_module(sys.argv[1])
for point in importlib.metadata.distribution(sys.argv[1]).entry_points:
    point.load()
    print("  loaded", point.group, point.name)
"""

LONGEST = 600
"""Seconds that one command may take."""


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    found = sorted(path.parent.name for path in ROOT.glob("integrations/*/README.md"))
    parser.add_argument("packages", nargs="*", metavar="PACKAGE", help=", ".join(found))
    named = parser.parse_args().packages
    if unknown := set(named) - set(found):
        parser.error(f"no package {', '.join(sorted(unknown))} in integrations/")
    wanted = named or [name for name in found if name not in HEAVY]
    failed = [name for name in wanted if not follow(name)]
    print(f"failed: {', '.join(failed)}" if failed else "all READMEs hold")
    return 1 if failed else 0


def follow(package: str) -> bool:
    """Whether all that a package's README says works as written."""
    print(f"{package}:", flush=True)
    readme = (ROOT / "integrations" / package / "README.md").read_text(encoding="utf-8")
    with tempfile.TemporaryDirectory(prefix="guest-") as folder:
        venv.create(Path(folder, "venv"), with_pip=True)
        programs = Path(folder, "venv", "bin")
        for command in installs(readme):
            if not succeeds(f"{programs}/{command} --quiet", cwd=ROOT):
                return False
        load = [f"{programs}/python", "-c", LOAD, package]
        if subprocess.run(load, cwd=folder, check=False).returncode:
            return False
        # Paths in a README begin at the repository; what it writes goes elsewhere.
        Path(folder, "integrations").symlink_to(ROOT / "integrations")
        return all(
            succeeds(f"{programs}/{command}", cwd=Path(folder))
            for command in commands(readme)
        ) and all(
            runs(programs / "python", code, folder) for code in programs_of(readme)
        )


def blocks(readme: str, language: str = "") -> list[str]:
    """Return the code blocks in a language."""
    # All are matched, since the end of one looks like the beginning of another.
    found = re.findall(r"^```(\w*)\n(.*?)^```", readme, re.DOTALL | re.MULTILINE)
    return [code for name, code in found if name == language]


def installs(readme: str) -> list[str]:
    lines = "\n".join(blocks(readme)).splitlines()
    return [line for line in lines if line.startswith("pip install ")]


def commands(readme: str) -> list[str]:
    """Return the commands of Python that stand in one line."""
    found = []
    for line in "\n".join(blocks(readme)).splitlines():
        whole = line.count('"') % 2 == 0 and "..." not in line
        if line.startswith("python ") and whole:
            found.append(line)
        elif line and not line.startswith(("pip install ", " ")):
            print(f"  left out: {line}")
    return found


def programs_of(readme: str) -> list[str]:
    """Return the blocks of Python that are whole programs."""
    return [code for code in blocks(readme, "python") if code.startswith("import ")]


def succeeds(command: str, *, cwd: Path) -> bool:
    done = subprocess.run(
        command, cwd=cwd, shell=True, timeout=LONGEST, check=False, capture_output=True
    )
    print(f"  {'ok' if not done.returncode else 'FAILED'}: {command}", flush=True)
    if done.returncode:
        print(done.stderr.decode(errors="replace")[-2000:], flush=True)
    return not done.returncode


def runs(python: Path, code: str, folder: str) -> bool:
    done = subprocess.run(
        [python, "-c", code], cwd=folder, timeout=LONGEST, check=False
    )
    print(f"  {'ok' if not done.returncode else 'FAILED'}: {code.splitlines()[0]}...")
    return not done.returncode


if __name__ == "__main__":
    sys.exit(main())
