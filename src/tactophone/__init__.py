"""A telephone for touch: a robot's fingertip hears a surface, an operator's fingertip feels it."""

from tactophone.errors import (
    ConfigError,
    DatasetError,
    DeviceError,
    ModelError,
    PacketError,
    TactophoneError,
)
from tactophone.types import AIR, CONTACT, AudioBlock, HapticCommand, PipelineStep, Prediction, Touch

__version__ = "0.1.0"

__all__ = [
    "AIR",
    "CONTACT",
    "AudioBlock",
    "ConfigError",
    "DatasetError",
    "DeviceError",
    "HapticCommand",
    "ModelError",
    "PacketError",
    "PipelineStep",
    "Prediction",
    "TactophoneError",
    "Touch",
    "__version__",
]
