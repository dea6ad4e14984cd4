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
from tactophone.microphones import AIR, CONTACT
from tactophone.types import (
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
    from tactophone.capture.files import FileSource
    from tactophone.capture.live import jack_source, portaudio_source
    from tactophone.haptics.limits import Limits
    from tactophone.haptics.oscillator import Oscillator
    from tactophone.haptics.profiles import open_profile
    from tactophone.perception.model_file import read_model
    from tactophone.perception.models import open_detector
    from tactophone.pipeline import Pipeline, open_pipeline
    from tactophone.tables import Live, Table, classify, live
    from tactophone.telemetry.watcher import Watcher

__version__ = "0.1.0"

__all__ = [
    "AIR", "CONTACT", "LIVE_SAMPLE_RATE", "AudioBlock", "ConfigError", "ContactThreshold", "DatasetError", "Detector",
    "DeviceError", "FileSource", "HapticCommand", "Limits", "Live", "ModelError", "Oscillator", "PacketError",
    "Pipeline", "PipelineStep", "Prediction", "Profile", "Source", "Table", "TactophoneError", "Touch", "Watcher",
    "__version__", "classify", "jack_source", "live", "open_detector", "open_pipeline", "open_profile",
    "portaudio_source", "read_model",
]  # fmt: skip

_MODULES = {
    "capture.files": ("FileSource",), "capture.live": ("jack_source", "portaudio_source"),
    "haptics.limits": ("Limits",), "haptics.oscillator": ("Oscillator",), "haptics.profiles": ("open_profile",),
    "perception.model_file": ("read_model",), "perception.models": ("open_detector",),
    "pipeline": ("Pipeline", "open_pipeline"), "tables": ("Live", "Table", "classify", "live"),
    "telemetry.watcher": ("Watcher",),
}  # fmt: skip


def __getattr__(name: str) -> Any:
    """Import a public name from its module when it is first used."""
    for module, names in _MODULES.items():
        if name in names:
            return getattr(importlib.import_module(f"tactophone.{module}"), name)
    raise AttributeError(f"module 'tactophone' has no attribute {name!r}")
