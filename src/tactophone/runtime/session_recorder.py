"""Writes the session log of a running end into telemetry: one short call per arrival, for whoever keeps the log."""

import hashlib
import importlib.metadata
import math
import platform
import time
from collections.abc import Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import tactophone
from tactophone.config import Settings
from tactophone.hand_file import each_finger
from tactophone.link import Event, write_event
from tactophone.perception import default_model, model_path
from tactophone.telemetry import Controls, EventBatch, Record, RunStart, Telemetry, write_record

_PACKAGES = ("numpy", "onnxruntime", "opuslib-next")


class SessionRecorder:
    """Logs what an end receives and what steers it; its calls belong to one thread, or stand under one lock.

    Parameters
    ----------
    telemetry
        Gets the records; the first says how the process was started.
    role
        ``operator`` or ``robot``.
    """

    def __init__(self, telemetry: Telemetry, settings: Settings, *, role: str) -> None:
        self._telemetry = telemetry
        self._controls: dict[int, Controls] = {}
        self._write(describe_run(settings, role=role))

    def arrival(self, now: float, events: Sequence[Event], polled: bool = False) -> None:
        """Log events that are processed together at ``now`` (s)."""
        self._write(EventBatch(now, tuple(map(write_event, events)), polled))

    def controls(self, controls: Controls, *, step: int = 0) -> None:
        """Log a finger's controls if they have changed, and the step of the last arrival during which they did."""
        if controls != self._controls.get(controls.finger):
            self._controls[controls.finger] = controls
            self._write(Controls(**{**asdict(controls), "step": step}))

    def _write(self, record: Record) -> None:
        for part in write_record(record):
            self._telemetry.log(part)


def describe_run(settings: Settings, *, role: str) -> RunStart:
    """Describe a process that starts now, completely enough to run it again."""
    fingers = each_finger(settings)
    models = {own.detector.model or default_model(2, own.capture.tip): "" for own in fingers}
    tables = asdict(replace(settings, fingers=()))
    del tables["fingers"]
    return RunStart(
        role=role,
        settings={
            section: {name: _without_nan(value) for name, value in table.items()} for section, table in tables.items()
        },
        models={name: hashlib.sha256(model_path(name).read_bytes()).hexdigest() for name in models},
        versions={
            "tactophone": tactophone.__version__,
            "python": platform.python_version(),
            **{package: _version(package) for package in _PACKAGES},
        },
        calibration=_calibration(settings),
        epoch=time.time() - time.monotonic(),
        fingers=[
            {
                "name": finger.name,
                "settings": {name: _without_nan(value) for name, value in finger.settings},
                "calibration": _calibration(own),
            }
            for finger, own in zip(settings.fingers, fingers, strict=False)
        ],
    )


def _calibration(settings: Settings) -> str:
    path = settings.detector.calibration
    return Path(path).expanduser().read_text() if path else ""


def _without_nan(value: Any) -> Any:
    return None if isinstance(value, float) and math.isnan(value) else value


def _version(package: str) -> str:
    try:
        return importlib.metadata.version(package)
    except importlib.metadata.PackageNotFoundError:
        return ""
