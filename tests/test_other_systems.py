"""What needs no live sound runs without the modules and functions that Unix alone has, as on Windows."""

import subprocess
import sys
from pathlib import Path

from tests.lab.dataset.folders import write_sound

HIDING = """
import os, signal, sys

class Hidden:
    def find_spec(self, name, path=None, target=None):
        if name in UNIX:
            raise ModuleNotFoundError(f"No module named {name!r}", name=name)

UNIX = {"fcntl", "termios", "tty", "pty", "resource", "pwd", "grp", "syslog", "_posixshmem"}
for name in UNIX:
    sys.modules.pop(name, None)
sys.meta_path.insert(0, Hidden())
import subprocess  # which itself looks for what is taken away now
for name in ("getuid", "geteuid", "nice", "sched_setscheduler", "sched_getscheduler", "fork"):
    delattr(os, name)
for name in ("SIGUSR1", "SIGHUP", "SIGALRM", "pthread_sigmask"):
    delattr(signal, name)
"""

WORK = """
import contextlib, io
import tactophone
from tactophone.cli import main

for verb in ("feel", "train", "finetune", "evaluate", "benchmark", "dataset", "simulate", "model"):
    with contextlib.redirect_stdout(io.StringIO()) as help, contextlib.suppress(SystemExit):
        main([verb, "--help"])
    assert "usage: tactophone" in help.getvalue(), verb
import tactophone.cli.data, tactophone.cli.dataset, tactophone.cli.evaluate, tactophone.cli.model
import tactophone.cli.record, tactophone.cli.simulate, tactophone.cli.train, tactophone.lab.simulation.render
assert len(tactophone.classify(sys.argv[1]).times) > 10
assert main(["feel", sys.argv[1], "--out", sys.argv[2], "--plot"]) == 0
assert main(["dataset", "check", sys.argv[2]]) in (0, 1)
assert main(["model", "show", "texture"]) == 0
print("all of it ran")
"""


def test_feel_and_the_workshop_need_no_module_of_unix(tmp_path: Path) -> None:
    sound = write_sound(tmp_path / "stroke.wav")
    command = [sys.executable, "-c", HIDING + WORK, str(sound), str(tmp_path / "felt")]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
    assert done.stdout.endswith("all of it ran\n"), done.stderr[-2000:]
