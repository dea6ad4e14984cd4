"""What a running end leaves for watchers and for the log: collected while packets are
processed, written later.

Nothing on the way from a datagram to a command needs marks, the step's telemetry or the
session log. Written packet by packet, each of these calls finds cold caches; ten in a
row take the time of three (measured).
"""

import hashlib
import importlib.metadata
import itertools
import platform
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from tactophone.core.hand import each_finger
from tactophone.core.plugins import DETECTORS, registered
from tactophone.core.settings import Settings
from tactophone.core.types import PipelineStep
from tactophone.core.version import __version__
from tactophone.live.telemetry.layout import LARGEST_RECORD
from tactophone.live.telemetry.records import (
    Controls,
    EventBatch,
    Record,
    RunStart,
    write_record,
)
from tactophone.live.telemetry.writer import Telemetry
from tactophone.net.link.events import Event, write_event
from tactophone.signal.perception.models import default_model, model_path

LONGEST_DEFERRAL = 0.02
"""Seconds for which the oldest step may wait without a prediction: the main thread
looks at telemetry as often."""

_MOST_WAITING = 32
"""Arrivals that may wait for a `SessionRecorder.write`, where nothing else asks for it,
as without any sound."""

_PACKAGES = ("numpy", "onnxruntime", "opuslib-next")
"""Packages whose versions a log names, as they may change a bit of the result."""


class SessionRecorder:
    """Records what an end receives, what steers it and what it computes, after how its
    process was started.

    Its calls belong to one thread, and nobody else publishes steps. Where another
    thread calls `arrival`, that call and `write` stand under one lock.
    """

    def __init__(self, telemetry: Telemetry, settings: Settings, *, role: str) -> None:
        self._telemetry = telemetry
        self._controls: dict[int, tuple[object, ...]] = {}
        """Controls that were logged last, by finger."""
        self._arrivals: list[Controls | tuple[float, list[Event], bool]] = []
        """Controls, and what arrived: when, the events, and whether they were
        polled."""
        self._marks: list[tuple[int, tuple[tuple[int, float], ...]]] = []
        """RTP timestamps, and which stages their sound has reached when."""
        self._steps: list[tuple[PipelineStep, float, int, int]] = []
        """Steps, when they were computed, the true touch, and the finger's count of
        vibration."""
        self._since: float | None = None
        """When somebody first asked whether a write is due, in s."""
        self._predicted = False
        """Whether a step that waits has a prediction."""
        self._log([describe_run(settings, role=role)])

    def mark(self, position: int, *reached: tuple[int, float]) -> None:
        """Record that sound up to an RTP timestamp has reached each ``MARKS[index]``,
        and when (s)."""
        self._marks.append((position, reached))

    def publish(self, step: PipelineStep, *, now: float, truth: int = -1) -> None:
        """Take a step computed at ``now`` (s)."""
        self._steps.append(
            (step, now, truth, self._telemetry.vibration_count(step.finger))
        )
        # A prediction is shown once its packets are processed: bridges drive devices
        # with each.
        self._predicted = self._predicted or bool(step.predictions)

    def arrival(
        self, now: float, events: Sequence[Event], polled: bool = False
    ) -> None:
        """Log events that are processed together at ``now`` (s), at the next
        `write`."""
        self._arrivals.append((now, list(events), polled))
        if len(self._arrivals) >= _MOST_WAITING:
            self._log_arrivals()

    def controls(
        self,
        armed: bool,
        ceiling: float,
        output_level: float,
        profile: str,
        threshold_dbfs: float | None,
        *,
        step: int = 0,
        finger: int = 0,
    ) -> None:
        """Log a finger's controls (see `Controls`) if they have changed, with the step
        of the last arrival after which they did."""
        # This is called at each packet. The values are compared as they come, since
        # making a `Controls` takes longer than all else here.
        controls = armed, ceiling, output_level, profile, threshold_dbfs
        if controls != self._controls.get(finger):
            self._controls[finger] = controls
            self._arrivals.append(Controls(*controls, step, finger))

    def due(self, now: float) -> bool:
        """Return whether enough has been collected, or has waited for long enough; ask
        at least every few milliseconds."""
        if not self._steps and not self._arrivals:
            return False
        # The wait begins when somebody first asks, so that the clock need not be read
        # for each call above.
        if self._since is None:
            self._since = now
        return self._predicted or now - self._since >= LONGEST_DEFERRAL

    def write(self, truth_of: Callable[[int], int] | None = None) -> None:
        """Write everything in the order in which it came. ``truth_of`` returns the true
        touch of a finger, which replaces the one given with its steps."""
        self._since = None
        self._predicted = False
        # The log comes first: whoever reads a step finds what it was made of.
        self._log_arrivals()
        self._write_marks()
        steps = self._steps
        self._steps = []
        truths: dict[int, int] = {}
        if truth_of:
            fingers = {step.finger for step, *_ in steps}
            truths = {finger: truth_of(finger) for finger in fingers}
        for step, computed, touch, vibrated in steps:
            truth = truths.get(step.finger, touch)
            self._telemetry.publish(
                step, now=computed, truth=truth, vibration_count=vibrated
            )

    def _write_marks(self) -> None:
        marks = self._marks
        self._marks = []
        self._telemetry.mark(
            *(
                (index, position, now)
                for position, reached in marks
                for index, now in reached
            )
        )

    def _log_arrivals(self) -> None:
        arrivals = self._arrivals
        self._arrivals = []
        records: list[Record] = []
        for arrival in arrivals:
            if isinstance(arrival, Controls):
                records.append(arrival)
                continue
            now, events, polled = arrival
            records.append(EventBatch(now, tuple(map(write_event, events)), polled))
        self._log(records)

    def _log(self, records: Iterable[Record]) -> None:
        joined = b""
        for part in itertools.chain.from_iterable(map(write_record, records)):
            # Records are joined, as a call takes as long as ten of them.
            if len(joined) + len(part) > LARGEST_RECORD:
                self._telemetry.log(joined)
                joined = b""
            joined += part
        if joined:
            self._telemetry.log(joined)


def describe_run(settings: Settings, *, role: str) -> RunStart:
    """Describe a process that starts now, completely enough to run it again."""
    fingers = each_finger(settings)
    models = {own.detector.model or default_model(own.capture.tip) for own in fingers}
    # What another package registers is no file whose hash could be noted.
    models -= set(registered(DETECTORS))
    tables = asdict(settings)
    del tables["fingers"]
    # It may hold the password of a relay, and is not needed to run it again.
    del tables["call"]
    return RunStart(
        role=role,
        settings=_as_text(tables),
        models={
            _as_text(name): hashlib.sha256(model_path(name).read_bytes()).hexdigest()
            for name in models
        },
        versions={
            "tactophone": __version__,
            "python": platform.python_version(),
            **{package: _version(package) for package in _PACKAGES},
        },
        epoch=time.time() - time.monotonic(),
        fingers=[
            {
                "name": finger.name,
                "settings": _as_text(dict(finger.settings)),
                "calibration": _calibration(own),
            }
            for finger, own in zip(settings.fingers, fingers, strict=True)
        ],
    )


def _as_text(value: Any) -> Any:
    r"""Return settings with each byte of a file's name that is no UTF-8 written as
    ``\xff``, as a log holds text alone."""
    if isinstance(value, dict):
        return {key: _as_text(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [_as_text(item) for item in value]
    if isinstance(value, str):
        return value.encode("utf-8", "surrogateescape").decode(
            "utf-8", "backslashreplace"
        )
    return value


def _calibration(settings: Settings) -> str:
    """Return the text of the calibration file; empty without one."""
    path = settings.detector.calibration
    return Path(path).expanduser().read_text("utf-8") if path else ""


def _version(package: str) -> str:
    try:
        return importlib.metadata.version(package)
    except importlib.metadata.PackageNotFoundError:
        return ""
