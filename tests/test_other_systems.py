"""What needs no live sound runs without the modules and functions that Unix alone has,
as on Windows."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from tests.folders import audiofolder, write_sound

ROOT = Path(__file__).parent.parent

HIDING = """
import mmap, os, pathlib, signal, sys, warnings

class Hidden:
    def find_spec(self, name, path=None, target=None):
        if name in UNIX:
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)

UNIX = {"fcntl", "termios", "tty", "pty", "resource", "pwd", "grp", "syslog"}
PROCESSES = sys.argv[1] in ("train", "setup", "simulate", "evaluate")
# To start processes, this system's library needs shared memory, and signal masks below.
if not PROCESSES:
    UNIX.add("_posixshmem")
for name in UNIX:
    sys.modules.pop(name, None)
sys.meta_path.insert(0, Hidden())
import subprocess  # which itself looks for what is taken away now
if PROCESSES:
    # Asks for the system; on Windows it does without mmap's names.
    import torch
NAMES = {
    os: (
        "getuid",
        "geteuid",
        "nice",
        "sched_setscheduler",
        "sched_getscheduler",
        "sched_getaffinity",
        "fork",
    ),
    signal: ("SIGUSR1", "SIGHUP", "SIGALRM"),
    mmap: ("MAP_SHARED", "MAP_PRIVATE", "PROT_READ", "PROT_WRITE"),
}
if not PROCESSES:
    NAMES[signal] += ("pthread_sigmask",)
for module, names in NAMES.items():
    for name in names:
        if hasattr(module, name):
            delattr(module, name)

def refuse(event, args):
    if event == "open" and str(args[0]).startswith("/dev/shm"):
        raise FileNotFoundError(args[0])

sys.addaudithook(refuse)
# Windows reads and writes text as its language wants it, unless an encoding is named.
warnings.simplefilter("ignore", EncodingWarning)
ours = r"tactophone|__main__"
warnings.filterwarnings("error", category=EncodingWarning, module=ours)
"""

RUN = """
import sys
from tactophone.cli import main

sys.exit(main(sys.argv[1:]))
"""

IMPORTS = """
import tactophone
import tactophone.cli.feel, tactophone.cli.model, tactophone.faces.web.server
import tactophone_lab.cli.data, tactophone_lab.cli.dataset, tactophone_lab.cli.evaluate
import tactophone_lab.cli.record, tactophone_lab.cli.setup, tactophone_lab.cli.simulate
import tactophone_lab.cli.train, tactophone_lab.simulation.render
import conftest
assert len(tactophone.classify(sys.argv[1]).times) > 10
"""


def without_unix(
    code: str, *words: str, cwd: Path, warnings: str = "default"
) -> "subprocess.CompletedProcess[str]":
    paths = os.pathsep.join(
        map(str, (*ROOT.glob("packages/*/src"), *ROOT.glob("packages/*"), ROOT))
    )
    environment = {**os.environ, "PYTHONPATH": paths, "PYTHONIOENCODING": "cp1252"}
    command = [
        sys.executable,
        "-X",
        "warn_default_encoding",
        "-W",
        warnings,
        "-c",
        HIDING + code,
        *words,
    ]
    return subprocess.run(
        command,
        cwd=cwd,
        capture_output=True,
        text=True,
        timeout=300,
        check=False,
        env=environment,
    )


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("other-system")
    write_sound(folder / "stroke.wav")
    audiofolder(folder / "set")
    return folder


@pytest.mark.slow
def test_the_modules_and_the_api_load_without_a_warning(folder: Path) -> None:
    done = without_unix(IMPORTS, "stroke.wav", cwd=folder, warnings="error")
    assert done.returncode == 0, done.stderr[-2000:]


@pytest.mark.slow
@pytest.mark.parametrize(
    "words",
    [
        "feel stroke.wav --out felt --plot",
        "dataset check set",
        "simulate dataset simulated --objects 0,1,2,3,4,5 --takes long_light --seconds "
        "2; train simulated --out new.onnx --recipe level; evaluate new.onnx --data "
        "simulated",
        "model show texture",
        "setup --source finger --set simulation.gain_db=-20 --seconds 3 --yes --out "
        "own.onnx",
        "check --source finger --yes",
        "settings",
    ],
    ids=lambda words: " ".join(words.split()[:2]),
)
def test_a_verb_that_needs_no_live_sound_runs(folder: Path, words: str) -> None:
    for command in words.split("; "):
        done = without_unix(RUN, *command.split(), cwd=folder)
        assert done.returncode in ((0, 1) if words == "dataset check set" else (0,)), (
            done.stderr[-2000:]
        )
        assert "Traceback" not in done.stderr
