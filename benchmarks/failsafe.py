"""Time from a failure to silence, where the link, the robot, the operator's process or
the sound server fails.

The robot sends an endless stroke, and a JACK client records the peaks at the operator's
port. Something is stopped, and the time is measured until the vibration has fallen to
-60 dB. ``python benchmarks/failsafe.py`` (as root, Linux) kills the operator's process,
by turns with JACK and both its clients as ordinary threads and before all others: what
is longer in the first case was spent waiting for a processor.
"""

import argparse
import contextlib
import itertools
import math
import os
import signal
import statistics
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path

import numpy as np

from cells import in_ms
from tactophone.core.errors import TactophoneError
from tactophone.core.settings import Settings, change
from tactophone.core.types import LIVE_SAMPLE_RATE, AlwaysOpen, AudioBlock, FloatArray
from tactophone.live.audio.dummy import DummyServer
from tactophone.live.audio.jack import JackClient
from tactophone.live.runtime.pairing import Sides
from tactophone_lab.measurement.impulses import PEAK, Graph, running_sides

BLOCK = 128
"""Samples of a block of the stroke."""

SILENT = 1e-3
"""Amplitude that counts as silent: -60 dB of full drive."""

STROKE = 1.0
"""Seconds of vibration before the failure."""

AFTERMATH = 0.6
"""Seconds recorded after the failure."""

_LONGEST = 60.0
"""Seconds that are recorded at most."""

STROKE_TONE = 330.0
"""Hz of the stroke at the contact microphone: between the harmonics of the mains, or
the check of the microphones would call it hum."""

AIR_TONE = 620.0
"""Hz of the stroke at the air microphone: the same sound at both would be a fault, and
far brighter sound would be smooth, so that hardly anything vibrated."""

AIR_PEAK = 0.5
"""Amplitude of the stroke at the air microphone."""

ENDLESS_TONE = ("detector.model=paper", "detector.threshold_dbfs=-26")
"""Settings for an endless tone: it has no rest in which a noise floor could be
measured, so the threshold is given."""


class EndlessStroke(AlwaysOpen):
    """A source of an endless tone, another one at each microphone, so that the check of
    the microphones may be on as in use."""

    sample_rate, channels = LIVE_SAMPLE_RATE, 2

    def __init__(self, _: Settings) -> None:
        times = np.arange(LIVE_SAMPLE_RATE + BLOCK) / LIVE_SAMPLE_RATE
        contact = PEAK * np.sin(2 * np.pi * STROKE_TONE * times)
        air = AIR_PEAK * np.sin(2 * np.pi * AIR_TONE * times)
        self._second = np.stack([contact, air], axis=1).astype(np.float32)

    def __iter__(self) -> Iterator[AudioBlock]:
        for start in itertools.count(0, BLOCK):
            # A second is a whole number of periods of both tones.
            phase = start % LIVE_SAMPLE_RATE
            yield AudioBlock(
                self._second[phase : phase + BLOCK], LIVE_SAMPLE_RATE, start
            )


class PeakRecorder:
    """Records the time and the peak amplitude of each period; ``process`` is for a JACK
    client."""

    def __init__(self) -> None:
        self._rows = np.zeros((int(_LONGEST * LIVE_SAMPLE_RATE / 16), 2))
        self._count = 0

    def process(self, inputs: list[FloatArray], _: list[FloatArray]) -> None:
        """Record a period, as the JACK callback."""
        if self._count < len(self._rows):
            self._rows[self._count] = time.monotonic(), np.abs(inputs[0]).max()
            self._count += 1

    @property
    def peak(self) -> float:
        """Peak amplitude of the newest period."""
        return float(self._rows[self._count - 1, 1]) if self._count else 0.0

    def time_to_silence(self, moment: float) -> float:
        """Return the seconds from ``moment`` until all further periods are silent;
        infinite if they never are.

        While a sound server stalls, its output is unknown and counts as vibrating.
        """
        rows = self._rows[: self._count]
        loud = np.flatnonzero(rows[:, 1] > SILENT)
        if not len(loud) or loud[-1] == len(rows) - 1:
            return math.inf
        return float(rows[loud[-1] + 1, 0] - moment)


def kill_robot(sides: Sides) -> None:
    os.kill(sides.robot.pid, signal.SIGKILL)


def freeze_robot(sides: Sides) -> None:
    """Stop the robot's process, as a debugger would."""
    os.kill(sides.robot.pid, signal.SIGSTOP)


def kill_operator(sides: Sides) -> None:
    os.kill(sides.operator.pid, signal.SIGKILL)


def freeze_operator(sides: Sides) -> None:
    """Stop the operator's process, as a debugger would."""
    os.kill(sides.operator.pid, signal.SIGSTOP)


def measure_time_to_silence(
    settings: Settings, graph: Graph, stop: Callable[[Sides], None]
) -> float:
    """Start a stroke, stop something, and return the seconds until silence.

    Raises `TactophoneError` when there is no vibration to begin with.
    """
    recorder = PeakRecorder()
    settings = change(settings, ENDLESS_TONE)
    with (
        running_sides(settings, graph, open_source=EndlessStroke) as sides,
        recording(recorder, graph, sides),
    ):
        time.sleep(STROKE)
        _await_vibration(
            recorder
        )  # again: on a busy machine it may have faded for a moment
        moment = time.monotonic()
        stop(sides)
        time.sleep(AFTERMATH)
        for side in (sides.robot, sides.operator):
            with contextlib.suppress(ProcessLookupError):
                os.kill(
                    side.pid, signal.SIGCONT
                )  # a frozen process would only end once it is killed, after seconds
        return recorder.time_to_silence(moment)


@contextmanager
def recording(
    recorder: PeakRecorder, graph: Graph, sides: Sides
) -> Iterator[JackClient]:
    """Record the vibration from when it has started; yields the recording client."""
    wires = {"vibration": graph.vibration_port or f"{sides.operator.name}:vibration"}
    client = JackClient(
        "tactophone-recorder",
        recorder.process,
        inputs=wires,
        outputs={},
        server=graph.server,
    )
    client.open()
    try:
        _await_vibration(recorder)
        yield client
    finally:
        client.close()


def _await_vibration(recorder: PeakRecorder) -> None:
    for _ in range(500):
        if recorder.peak > SILENT:
            return
        time.sleep(0.01)
    raise TactophoneError(
        "no vibration within 5 s: try `tactophone latency --dummy` to see what fails"
    )


FIFO_PRIORITY = 40


def _schedule(pid: int, *, first: bool) -> None:
    """Let the threads of a process run before all others, or as others do."""
    policy = os.SCHED_FIFO if first else os.SCHED_OTHER
    for task in Path(f"/proc/{pid}/task").iterdir():
        with contextlib.suppress(OSError):
            os.sched_setscheduler(
                int(task.name), policy, os.sched_param(FIFO_PRIORITY * first)
            )


def _waited(pid: int) -> float:
    """Seconds for which a process's threads waited for a processor so far, by the
    scheduler's own count."""
    return (
        sum(
            int((task / "schedstat").read_text().split()[1])
            for task in Path(f"/proc/{pid}/task").iterdir()
        )
        / 1e9
    )


def main() -> None:
    """Print a table of the times to silence after the operator's process was killed."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--kills", type=int, default=20, metavar="N", help="of each kind; default 20"
    )
    kills = parser.parse_args().kills
    found: tuple[list[float], ...] = ([], [])
    waits: tuple[list[float], ...] = ([], [])
    for number in range(2 * kills):
        first, before = bool(number % 2), [0.0]
        _schedule(os.getpid(), first=False)
        with DummyServer(128, synchronous=False) as server:
            jack = server.pid

            def stop(
                sides: Sides,
                jack: int = jack,
                first: bool = first,
                before: list[float] = before,
            ) -> None:
                for pid in (jack, os.getpid(), sides.operator.pid):
                    _schedule(pid, first=first)
                before[0] = _waited(jack)
                kill_operator(sides)

            found[first].append(
                measure_time_to_silence(Settings(), Graph(server.name), stop)
            )
            waits[first].append(_waited(jack) - before[0])
    print(
        f"Load {os.getloadavg()[0]:.0f}. JACK's wait is the sum over its threads, "
        "after the kill. *Never*: still vibrating at the end.\n"
    )
    print(
        "| operator killed | time to silence: p50, worst | over 100 ms | JACK waited "
        f"for a processor in {AFTERMATH:g} s: p50, worst |"
    )
    print("|---|---|--:|---|")
    for first, name in enumerate(
        ("all as ordinary threads", "JACK and both clients before all others")
    ):
        times, waited = (
            [1e3 * each for each in column[first]] for column in (found, waits)
        )
        print(
            f"| {name} | {in_ms(statistics.median(times))}, {in_ms(max(times))} | "
            f"{sum(each > 100 for each in times)} of "
            f"{len(times)} | {statistics.median(waited):.0f}, {max(waited):.0f} ms |"
        )


if __name__ == "__main__":
    main()
