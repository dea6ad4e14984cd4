"""A loopback in processes of its own that records, for tests that kill it."""

import os
import subprocess
import sys
import time
import uuid
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

import numpy as np
import psutil
import soundfile

from tactophone.errors import TactophoneError
from tactophone.telemetry.watcher import Watcher


class WatchedLoopback:
    """Its processes, and what its telemetry says."""

    def __init__(self, process: "subprocess.Popen[bytes]", name: str) -> None:
        self._process, self._watcher = process, Watcher(name)

    def kill(self, number: int) -> None:
        """Kill the process with the audio callback."""
        os.kill(self._watcher.pid, number)

    def family(self) -> list[int]:
        """Every process of the run, the supervisor first so that it replaces nothing."""
        root = psutil.Process(self._process.pid)
        return [root.pid, *(child.pid for child in root.children(recursive=True))]

    def newest_prediction(self) -> float:
        """End of the newest prediction's window, in s."""
        rows, _ = self._watcher.predictions()
        return float(rows["window_end"][-1])


@contextmanager
def start_loopback(
    folder: Path, *, predictions: int = 150
) -> Iterator[tuple["subprocess.Popen[bytes]", WatchedLoopback]]:
    """Start it, and wait until it has made so many predictions."""
    noise = np.random.default_rng(0).normal(0, 0.05, (48_000 * 20, 2))
    soundfile.write(folder / "noise.wav", noise, 48_000)
    name = f"test-{uuid.uuid4().hex[:8]}"
    command = [sys.executable, "-m", "tactophone", "loopback", "--actuator", "none"]
    command += ["--name", name, "--source", f"file:{folder / 'noise.wav'}", "--record", str(folder / "run.mcap")]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL) as process:
        try:
            until = time.monotonic() + 60
            while time.monotonic() < until:
                time.sleep(0.05)
                log = folder / "run.mcap"
                # On a busy machine the recorder may need seconds to start; telemetry keeps the beginning for it.
                begun = log.exists() and log.stat().st_size > 30_000
                with suppress(TactophoneError):
                    if begun and Watcher(name).totals()[0]["predictions"] >= predictions:
                        yield process, WatchedLoopback(process, name)
                        return
            raise TimeoutError(f"{name} made fewer than {predictions} predictions in 60 s")
        finally:
            process.kill()
