"""NVIDIA Isaac Teleop: Isaac's pulses rendered under our limits, and our commands as its pulses.

Isaac's ``ControllerHapticPulse`` is amplitude 0-1, frequency in Hz and duration in s, as OpenXR's XrHapticVibration.
`TactophoneDevice` is an ``IHapticDevice``: Isaac's ``HapticSink`` passes it the pulses of a simulation. `RunPulses`
goes the other way, for XR controllers and gloves that Isaac drives. Needs the extra ``isaac``.
"""

import math
import time
from collections.abc import Callable
from typing import Any

import numpy as np
from isaacteleop.haptic_devices import IHapticDevice
from isaacteleop.retargeting_engine.tensor_types import ControllerHapticPulse
from numpy.typing import NDArray

from tactophone.bridges.reader import NewestReader
from tactophone.types import DEFAULT_CEILING, FINGER_NAMES, HapticCommand

DEFAULT_FREQUENCY = 160.0
"""Hz where a pulse leaves the frequency to the device (OpenXR: XR_FREQUENCY_UNSPECIFIED)."""

LONGEST_PULSE = 1.0
"""Seconds after which a pulse ends whatever its duration says."""

PULSE_DURATION = 0.03
"""Seconds of our pulses: three predictions, so that one lost step is no gap, and a dead run is silent at once."""


class TactophoneDevice(IHapticDevice):
    """Renders Isaac's pulses.

    ``submit`` takes each command: ``Oscillator(Limits()).submit``, whose limits bound it again and which fades by
    itself when no command follows. ``endpoint`` names the actuator in Isaac, ``ceiling`` is the greatest amplitude, 0-1
    of full drive, and ``clock`` returns seconds.

    Attributes
    ----------
    faults
        Pulses that were no finite numbers; each is silence.
    """

    def __init__(
        self, submit: Callable[[HapticCommand], None], *, endpoint: str = "right", ceiling: float = DEFAULT_CEILING,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:  # fmt: skip
        self.faults = 0
        self._submit, self._endpoint, self._ceiling, self._clock = submit, endpoint, ceiling, clock
        self._amplitude = self._frequency = 0.0
        self._until = -math.inf

    def accepted_type(self) -> Any:
        """Return the type of a pulse."""
        return ControllerHapticPulse()

    def endpoints(self) -> tuple[str, ...]:
        """Return the one actuator."""
        return (self._endpoint,)

    def apply(self, endpoint: str, values: NDArray[Any]) -> None:
        """Store a pulse."""
        amplitude, frequency, duration = (float(value) for value in values)
        if not all(map(math.isfinite, (amplitude, frequency, duration))):
            self.faults += 1
            amplitude = 0.0
        self._amplitude = min(max(amplitude, 0.0), self._ceiling)
        self._frequency = frequency if math.isfinite(frequency) and frequency > 0 else DEFAULT_FREQUENCY
        # A pulse of no length lasts until the next step, as in OpenXR.
        length = min(max(duration, PULSE_DURATION), LONGEST_PULSE) if math.isfinite(duration) else 0.0
        self._until = self._clock() + length

    def flush(self, deviceio_session: Any) -> None:
        """Submit the present command: the pulse while it lasts, then silence."""
        now = self._clock()
        amplitude = self._amplitude if now < self._until else 0.0
        self._submit(HapticCommand(amplitude, self._frequency or DEFAULT_FREQUENCY, now))

    def get_tracker(self) -> None:
        """Return nothing: no tracker of Isaac's is used."""


class RunPulses:
    """The newest command of a run on this machine as Isaac's tensors; read it once a step."""

    def __init__(self, name: str) -> None:
        self._reader = NewestReader(name)

    def pulse(self) -> NDArray[np.float32]:
        """Return ``[amplitude, frequency_hz, duration_s]``, of a hand the strongest; 0 where no command is new."""
        commands = [newest.command for newest in self._reader.read().values()]
        if not commands:
            return np.zeros(3, np.float32)
        strongest = max(commands, key=lambda command: command.amplitude)
        return np.array([strongest.amplitude, strongest.frequency, PULSE_DURATION], np.float32)

    def finger_power(self, finger: str = "index") -> NDArray[np.float32]:
        """Return a ``FingerPowerVector``, thumb to little finger, 0-1: of a hand each its own, else at one finger."""
        found = self._reader.read()
        amplitudes = {
            name if len(self._reader.fingers) > 1 else finger: found[name].command.amplitude for name in found
        }
        return np.array([amplitudes.get(name, 0.0) for name in FINGER_NAMES], np.float32)
