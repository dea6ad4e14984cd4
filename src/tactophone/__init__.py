"""A telephone for touch: microphones on a robot's fingertip, vibration on an operator's.

The public API::

    from tactophone import FileSource, Oscillator, open_pipeline

    source, oscillator = FileSource("finger.wav", block_size=480), Oscillator()
    pipeline = open_pipeline(sample_rate=source.sample_rate, channels=source.channels)
    with source:
        for block in source:
            for command in pipeline.push(block).commands:
                oscillator.submit(command)

Values and errors are imported at once, everything else when it is first used.
"""

import importlib
from typing import TYPE_CHECKING, Any

from tactophone.errors import ConfigError, DatasetError, DeviceError, ModelError, PacketError, TactophoneError
from tactophone.types import (
    AIR,
    CONTACT,
    LIVE_SAMPLE_RATE,
    AudioBlock,
    ContactThreshold,
    Detector,
    HapticCommand,
    PipelineStep,
    Prediction,
    Profile,
    Source,
    Touch,
)

if TYPE_CHECKING:
    from tactophone.capture import FileSource, jack_source, portaudio_source
    from tactophone.haptics import Limits, Oscillator, open_profile
    from tactophone.perception import open_detector, read_model
    from tactophone.pipeline import Pipeline, open_pipeline
    from tactophone.telemetry import Watcher

__version__ = "0.1.0"

__all__ = [
    "AIR",
    "CONTACT",
    "LIVE_SAMPLE_RATE",
    "AudioBlock",
    "ConfigError",
    "ContactThreshold",
    "DatasetError",
    "Detector",
    "DeviceError",
    "FileSource",
    "HapticCommand",
    "Limits",
    "ModelError",
    "Oscillator",
    "PacketError",
    "Pipeline",
    "PipelineStep",
    "Prediction",
    "Profile",
    "Source",
    "TactophoneError",
    "Touch",
    "Watcher",
    "__version__",
    "jack_source",
    "open_detector",
    "open_pipeline",
    "open_profile",
    "portaudio_source",
    "read_model",
]

_ROOMS = {
    "capture": ("FileSource", "jack_source", "portaudio_source"),
    "haptics": ("Limits", "Oscillator", "open_profile"),
    "perception": ("open_detector", "read_model"),
    "pipeline": ("Pipeline", "open_pipeline"),
    "telemetry": ("Watcher",),
}


def __getattr__(name: str) -> Any:
    """Import a public name from its room when it is first used."""
    for room, names in _ROOMS.items():
        if name in names:
            return getattr(importlib.import_module(f"tactophone.{room}"), name)
    raise AttributeError(f"module 'tactophone' has no attribute {name!r}")
