"""Render pulses of NVIDIA Isaac Teleop with our oscillator, under its limits.

``python -m isaacteleop_tactophone.device pulse.wav`` writes the vibration of one pulse.

Isaac's ``ControllerHapticPulse`` is amplitude 0-1, frequency in Hz and duration in s,
as OpenXR's XrHapticVibration. `TactophoneDevice` is an ``IHapticDevice``: Isaac's
``HapticSink`` passes it the pulses of a simulation.
"""

import math
import sys
import time
from collections.abc import Callable
from typing import Any

import numpy as np
import soundfile
from isaacteleop.haptic_devices import IHapticDevice
from isaacteleop.retargeting_engine.deviceio_source_nodes import HapticSink
from isaacteleop.retargeting_engine.tensor_types import ControllerHapticPulse
from numpy.typing import NDArray

from tactophone import HapticCommand, Limits, Oscillator

DEFAULT_FREQUENCY = 160.0
"""Hz where a pulse leaves the frequency to the device (OpenXR:
XR_FREQUENCY_UNSPECIFIED)."""

LONGEST_PULSE = 1.0
"""Seconds after which a pulse ends whatever its duration says."""

PULSE_DURATION = 0.03
"""Seconds that a pulse lasts at least, so that one lost step of Isaac is no gap."""


class TactophoneDevice(IHapticDevice):
    """Renders Isaac's pulses.

    ``submit`` takes each command: ``Oscillator(Limits()).submit``, whose limits bound
    it again and which fades by itself when no command follows. ``endpoint`` names the
    actuator in Isaac, ``ceiling`` is the greatest amplitude, 0-1 of full drive, and
    ``clock`` returns seconds.

    Attributes
    ----------
    faults
        Pulses that were no finite numbers; each is silence.
    """

    def __init__(
        self,
        submit: Callable[[HapticCommand], None],
        *,
        endpoint: str = "right",
        ceiling: float = 0.5,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self.faults = 0
        self._submit, self._endpoint, self._ceiling, self._clock = (
            submit,
            endpoint,
            ceiling,
            clock,
        )
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
        self._frequency = (
            frequency
            if math.isfinite(frequency) and frequency > 0
            else DEFAULT_FREQUENCY
        )
        # A pulse of no length lasts until the next step, as in OpenXR.
        length = (
            min(max(duration, PULSE_DURATION), LONGEST_PULSE)
            if math.isfinite(duration)
            else 0.0
        )
        self._until = self._clock() + length

    def flush(self, deviceio_session: Any) -> None:
        """Submit the present command: the pulse while it lasts, then silence."""
        now = self._clock()
        amplitude = self._amplitude if now < self._until else 0.0
        self._submit(
            HapticCommand(amplitude, self._frequency or DEFAULT_FREQUENCY, now)
        )

    def get_tracker(self) -> None:
        """Return nothing: no tracker of Isaac's is used."""


def main() -> None:
    """Apply a pulse by hand, where an Isaac graph would, and write the vibration."""
    oscillator = Oscillator(Limits(ceiling=0.3))
    # Connect this in an Isaac graph.
    sink = HapticSink("fingertip", TactophoneDevice(oscillator.submit))
    vibration = np.zeros((20, 480), np.float32)
    for step, wave in enumerate(vibration):
        if step < 10:  # a controller's pulse: amplitude, frequency in Hz, duration in s
            sink.device.apply("right", np.array([1.0, 120.0, 0.02]))
        sink.flush_to_device(None)
        oscillator.render(wave)
    soundfile.write(sys.argv[1], vibration.ravel(), 48_000)
    print(f"peak {abs(vibration).max():.2f} of full drive")


if __name__ == "__main__":
    main()
