"""A telephone for touch: microphones on a robot's fingertip, vibration on an
operator's.

The public API::

    from tactophone import Oscillator, open_live, open_recording

    for step in open_recording("finger.wav").steps():   # as `tactophone feel` decides
        step.predictions, step.commands

    oscillator = Oscillator()
    for step in open_live("jack"):                      # as a live run decides
        for command in step.commands:
            oscillator.submit(command)

Values and errors are imported at once, everything else when it is first used.
"""

import importlib
from typing import TYPE_CHECKING, Any

from tactophone.core import usage_statistics
from tactophone.core.errors import (
    ConfigError,
    DatasetError,
    DeviceError,
    ModelError,
    PacketError,
    TactophoneError,
)
from tactophone.core.microphones import AIR, CONTACT
from tactophone.core.types import (
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
from tactophone.core.version import __version__

# Before any of the modules below can import ONNX Runtime.
usage_statistics.switch_off()

if TYPE_CHECKING:
    from tactophone.app.compare import Comparison, compare
    from tactophone.app.live import Live, open_live
    from tactophone.app.recordings import OpenRecording, open_recording
    from tactophone.app.tables import Table, classify
    from tactophone.live.audio.files import FileSource
    from tactophone.live.audio.sources import jack_source, portaudio_source
    from tactophone.live.telemetry.watcher import Watcher
    from tactophone.signal.haptics.limits import Limits
    from tactophone.signal.haptics.oscillator import Oscillator
    from tactophone.signal.haptics.profiles import open_profile
    from tactophone.signal.perception.model_file import read_model
    from tactophone.signal.perception.opening import DetectorOptions, open_detector
    from tactophone.signal.pipeline import Pipeline, open_pipeline

__all__ = [
    "AIR",
    "CONTACT",
    "LIVE_SAMPLE_RATE",
    "AudioBlock",
    "Comparison",
    "ConfigError",
    "ContactThreshold",
    "DatasetError",
    "Detector",
    "DetectorOptions",
    "DeviceError",
    "FileSource",
    "HapticCommand",
    "Limits",
    "Live",
    "ModelError",
    "OpenRecording",
    "Oscillator",
    "PacketError",
    "Pipeline",
    "PipelineStep",
    "Prediction",
    "Profile",
    "Source",
    "Table",
    "TactophoneError",
    "Touch",
    "Watcher",
    "__version__",
    "classify",
    "compare",
    "jack_source",
    "open_detector",
    "open_live",
    "open_pipeline",
    "open_profile",
    "open_recording",
    "portaudio_source",
    "read_model",
]

_HOME = {
    "Comparison": "app.compare",
    "compare": "app.compare",
    "Live": "app.live",
    "open_live": "app.live",
    "OpenRecording": "app.recordings",
    "open_recording": "app.recordings",
    "Table": "app.tables",
    "classify": "app.tables",
    "FileSource": "live.audio.files",
    "jack_source": "live.audio.sources",
    "portaudio_source": "live.audio.sources",
    "Watcher": "live.telemetry.watcher",
    "Limits": "signal.haptics.limits",
    "Oscillator": "signal.haptics.oscillator",
    "open_profile": "signal.haptics.profiles",
    "read_model": "signal.perception.model_file",
    "DetectorOptions": "signal.perception.opening",
    "open_detector": "signal.perception.opening",
    "Pipeline": "signal.pipeline",
    "open_pipeline": "signal.pipeline",
}
"""Public names that are imported when they are first used, and their modules.

Importing them all at once would load ONNX Runtime and sound libraries for a program
that wants only the values. Type checkers do not run ``__getattr__``, so the same names
are imported above for them; `tests/test_public_api.py` holds that every name of
``__all__`` can be imported.
"""


def __getattr__(name: str) -> Any:
    """Import a public name from its module when it is first used."""
    if name not in _HOME:
        raise AttributeError(f"module 'tactophone' has no attribute {name!r}")
    return getattr(importlib.import_module(f"tactophone.{_HOME[name]}"), name)
