"""Ctrl-C in a terminal reaches every process there: those that are only starting show no traceback."""

import subprocess
import sys
from pathlib import Path

SCRIPT = """
import os, signal, sys
from tactophone.child_processes import ChildContext

def blocked():
    return signal.SIGINT in signal.pthread_sigmask(signal.SIG_BLOCK, ())

def work(answer):
    os.kill(os.getpid(), signal.SIGINT)
    answer.send(blocked())

if __name__ == "__main__":
    context = ChildContext()
    for _ in range(2):  # the first child starts a process of multiprocessing's own, too
        mine, its = context.Pipe()
        child = context.Process(target=work, args=(its,), daemon=True)
        child.start()
        print(mine.recv(), blocked(), child.join() or child.exitcode)
"""


def test_ctrl_c_is_blocked_in_a_child_from_its_start_and_not_in_its_parent(tmp_path: Path) -> None:
    script = tmp_path / "script.py"
    script.write_text(SCRIPT)
    done = subprocess.run([sys.executable, str(script)], capture_output=True, text=True, timeout=60, check=True)
    assert (done.stdout, done.stderr) == ("True False 0\n" * 2, "")
