"""Tries a model file that this package does not ship in a process of its own.

Loading a graph may take any memory and any time, and may end the process that does it:
ONNX Runtime has no limits of its own. So a file of unknown origin is first loaded and
run by a child with limits of memory and time. If the child ends in order, this process
loads the same bytes.
"""

import functools
import hashlib
import json
import signal
import subprocess
import sys
import time
from contextlib import suppress
from importlib.resources import files
from pathlib import Path

from tactophone.core.errors import ModelError

TRIAL_MEMORY = 1_000_000_000
"""Bytes that a model may take in addition to Python and the libraries. The largest
shipped model takes 20 MB."""

TRIAL_PROCESSOR_TIME = 10
"""Seconds of processor time for loading and trying a model. A shipped one takes 0.3."""

TRIAL_TIMEOUT = 60.0
"""Seconds until the trial is given up, however busy the machine is."""

CHILD = "tactophone.signal.perception.model_trial_child"
"""Module that the child runs; by name, as it imports what calls this one."""

_tried: set[bytes] = set()
"""Digests of the files that have passed in this process's life."""


@functools.cache
def shipped_digests() -> frozenset[bytes]:
    """Return the SHA-256 digests of the models in this package."""
    folder = Path(str(files("tactophone.signal.perception"))) / "models"
    return frozenset(
        hashlib.sha256(path.read_bytes()).digest() for path in folder.glob("*.onnx")
    )


def try_in_child(path: Path, content: bytes) -> None:
    """Load and run a model in another process; raises `ModelError`, in one line, where
    it cannot be used or takes more than the limits. ``path`` is for messages."""
    digest = hashlib.sha256(content).digest()
    if digest in _tried:
        return
    try:
        child = subprocess.run(
            # -P: a folder of data is not a folder of code.
            [sys.executable, "-P", "-m", CHILD, str(path)],
            input=content,
            stdout=subprocess.PIPE,
            stderr=subprocess.DEVNULL,
            timeout=TRIAL_TIMEOUT,
            check=False,
        )
    except subprocess.TimeoutExpired:
        raise ModelError(
            f"{path}: not loaded within {TRIAL_TIMEOUT:g} s; export it again"
        ) from None
    # What else libraries have printed comes before the child's last line.
    last_line = child.stdout.rpartition(b"\n")[2]
    with suppress(ValueError):
        refusal = json.loads(last_line)
        if refusal:
            raise ModelError(str(refusal))
        _tried.add(digest)
        return
    raise ModelError(f"{path}: {_how_it_ended(child.returncode)}; export it again")


def _how_it_ended(code: int) -> str:
    if -code in (getattr(signal, "SIGXCPU", 0), getattr(signal, "SIGKILL", 0)):
        return f"takes over {TRIAL_PROCESSOR_TIME} s of processor time to load"
    return (
        f"ends the process that loads it ({code}), "
        f"as if it took over {TRIAL_MEMORY / 1e9:g} GB of memory"
    )


def limit_this_process() -> None:
    """Limit memory and processor time, where the system has such limits, to what is
    used already and the model's share."""
    with suppress(ImportError, OSError, ValueError):
        import resource

        used = round(time.process_time()) + 1
        seconds = used + TRIAL_PROCESSOR_TIME
        resource.setrlimit(resource.RLIMIT_CORE, (0, 0))
        # At the soft limit the signal says why; the hard one would only kill.
        resource.setrlimit(resource.RLIMIT_CPU, (seconds, seconds + 1))
        pages = int(Path("/proc/self/statm").read_text().split()[0])
        most = pages * resource.getpagesize() + TRIAL_MEMORY
        resource.setrlimit(resource.RLIMIT_AS, (most, most))
