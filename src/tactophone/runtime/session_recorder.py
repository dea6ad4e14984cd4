"""Writes the session log of a running end into telemetry: one short call per arrival, for whoever keeps the log."""

import hashlib
import importlib.metadata
import itertools
import platform
import time
from collections.abc import Iterable, Sequence
from dataclasses import asdict
from pathlib import Path

import tactophone
from tactophone.hand import each_finger
from tactophone.json_numbers import finite
from tactophone.link import Event, write_event
from tactophone.perception import default_model, model_path
from tactophone.settings import Settings
from tactophone.telemetry import LARGEST_RECORD, Controls, EventBatch, Record, RunStart, Telemetry, write_record

_MOST_WAITING = 32
"""Arrivals that may wait for a `SessionRecorder.write`, where nothing else asks for it, as without any sound."""

_PACKAGES = ("numpy", "onnxruntime", "opuslib-next")


class SessionRecorder:
    """Logs what an end receives and what steers it, after how the process was started.

    Its calls belong to one thread, or stand under one lock."""

    def __init__(self, telemetry: Telemetry, settings: Settings, *, role: str) -> None:
        self._telemetry = telemetry
        self._controls: dict[int, tuple[object, ...]] = {}
        self._waiting: list[Controls | tuple[float, list[Event], bool]] = []
        self._write([describe_run(settings, role=role)])

    def arrival(self, now: float, events: Sequence[Event], polled: bool = False) -> None:
        """Log events that are processed together at ``now`` (s), at the next `write`."""
        self._waiting.append((now, list(events), polled))
        if len(self._waiting) >= _MOST_WAITING:
            self.write()

    def controls(
        self, armed: bool, ceiling: float, output_level: float, limit: float, profile: str,
        threshold_dbfs: float | None, *, step: int = 0, finger: int = 0,
    ) -> None:  # fmt: skip
        """Log a finger's controls (see `Controls`) if they have changed, and the step of the last arrival meanwhile."""
        # Called at each packet, so compared as they come: making a `Controls` takes longer than all else here.
        controls = armed, ceiling, output_level, limit, profile, threshold_dbfs
        if controls != self._controls.get(finger):
            self._controls[finger] = controls
            self._waiting.append(Controls(*controls, step, finger))

    @property
    def waiting(self) -> bool:
        """Whether there is anything to `write`."""
        return bool(self._waiting)

    def write(self) -> None:
        """Write what waits; in the order in which it came."""
        waiting, self._waiting = self._waiting, []
        self._write(map(_as_record, waiting))

    def _write(self, records: Iterable[Record]) -> None:
        joined = b""
        for part in itertools.chain.from_iterable(map(write_record, records)):
            # Many in one call: each call takes as long as ten records.
            if len(joined) + len(part) > LARGEST_RECORD:
                self._telemetry.log(joined)
                joined = b""
            joined += part
        if joined:
            self._telemetry.log(joined)


def _as_record(waiting: Controls | tuple[float, list[Event], bool]) -> Record:
    if isinstance(waiting, Controls):
        return waiting
    now, events, polled = waiting
    return EventBatch(now, tuple(map(write_event, events)), polled)


def describe_run(settings: Settings, *, role: str) -> RunStart:
    """Describe a process that starts now, completely enough to run it again."""
    fingers = each_finger(settings)
    models = {own.detector.model or default_model(own.capture.tip): "" for own in fingers}
    tables = asdict(settings)
    del tables["fingers"]
    return RunStart(
        role=role,
        settings=finite(tables),
        models={name: hashlib.sha256(model_path(name).read_bytes()).hexdigest() for name in models},
        versions={
            "tactophone": tactophone.__version__,
            "python": platform.python_version(),
            **{package: _version(package) for package in _PACKAGES},
        },
        epoch=time.time() - time.monotonic(),
        fingers=[
            {
                "name": finger.name,
                "settings": finite(dict(finger.settings)),
                "calibration": _calibration(own),
            }
            for finger, own in zip(settings.fingers, fingers, strict=True)
        ],
    )


def _calibration(settings: Settings) -> str:
    path = settings.detector.calibration
    return Path(path).expanduser().read_text() if path else ""


def _version(package: str) -> str:
    try:
        return importlib.metadata.version(package)
    except importlib.metadata.PackageNotFoundError:
        return ""
