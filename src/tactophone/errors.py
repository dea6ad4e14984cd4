"""The exceptions that Tactophone raises on purpose.

::

    TactophoneError
    ├── ConfigError    a setting that is unknown, malformed or out of range
    ├── DeviceError    a sound device that is missing, wrong or lost
    ├── PacketError    bytes from the network that are not what they claim
    ├── ModelError     a model file that cannot be read or does not fit
    └── DatasetError   a recording, label or manifest that cannot be used

Our own mistake raises. The world's mistake (loss, lateness, bad bytes, underflow) is counted and shown. A
caller's slip, such as a negative size, stays :class:`ValueError`. Every message says what was found, what was
wanted, where, and the next step.
"""


class TactophoneError(Exception):
    """Anything Tactophone raises on purpose; the command line prints it in one line and exits with 1."""


class ConfigError(TactophoneError):
    """A setting is unknown, malformed or out of range."""


class DeviceError(TactophoneError):
    """A sound device is missing, has the wrong rate or too few channels, or was lost."""


class PacketError(TactophoneError):
    """Bytes from the network are not what they claim to be."""


class ModelError(TactophoneError):
    """A model file cannot be read, is not ours, or does not fit the sound at hand."""


class DatasetError(TactophoneError):
    """A recording, label or manifest cannot be used as it stands."""
