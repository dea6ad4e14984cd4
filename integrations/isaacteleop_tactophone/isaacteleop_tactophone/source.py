"""What a robot's fingertip hears, as haptic values of Isaac Teleop: controller pulses
and powers of fingers.

Isaac's own sources are forces; this one has the texture. It says *silence* wherever it
does not know: a run that ends, a link that breaks and a prediction that is late all end
the vibration within `SILENCE`, and a pulse never outlasts it, so that the vibration
ends as well where this process dies.
"""

import math
import time
from collections.abc import Callable, Sequence

import numpy as np
from isaacteleop.retargeting_engine.interface import BaseRetargeter
from isaacteleop.retargeting_engine.tensor_types import (
    ControllerHapticPulse,
    FingerPowerVector,
)
from numpy.typing import NDArray

from tactophone.live.log.reader import Passed, PredictionReader

SILENCE = 0.1
"""Seconds from the making of a command after which it is silence, whatever else
happens."""

Values = NDArray[np.float32]


class TouchSource(BaseRetargeter):
    """A node of Isaac's graph without inputs.

    Outputs
    -------
    pulse
        ``ControllerHapticPulse`` (amplitude 0-1, Hz, s) of the finger that vibrates
        most.
    powers
        ``FingerPowerVector``: the amplitude of each finger, 0-1, of ``fingers`` in
        order.

    Parameters
    ----------
    name
        Of the node.
    run
        Name of a run, as ``tactophone status`` lists it.
    fingers
        Of the glove; a run of one finger is ``index``.
    ceiling
        Greatest amplitude, 0-1, over the run's own limits.
    reader, clock
        For tests: what returns predictions as `PredictionReader`, and s of the
        monotonic clock.
    """

    def __init__(
        self,
        name: str,
        run: str,
        *,
        fingers: Sequence[str] = ("thumb", "index", "middle", "ring", "little"),
        ceiling: float = 0.5,
        reader: Callable[[], list[Passed]] | None = None,
        clock: Callable[[], float] = time.monotonic,
    ) -> None:
        self.fingers, self._ceiling, self._clock = tuple(fingers), ceiling, clock
        self._read = PredictionReader(run).read if reader is None else reader
        self._newest: dict[str, Passed] = {}
        super().__init__(name)

    def input_spec(self) -> dict:
        return {}

    def output_spec(self) -> dict:
        return {
            "pulse": ControllerHapticPulse(),
            "powers": FingerPowerVector(len(self.fingers)),
        }

    def values(self) -> tuple[Values, Values]:
        """Return the pulse and the powers of this moment; zeros where no command is
        known to hold."""
        self._newest |= {passed.finger: passed for passed in self._read()}
        now, pulse = self._clock(), np.zeros(3, np.float32)
        powers = np.zeros(len(self.fingers), np.float32)
        for finger, passed in self._newest.items():
            left = SILENCE - (now - passed.computed)
            command = passed.command
            sane = math.isfinite(command.amplitude) and math.isfinite(command.frequency)
            if not (sane and 0 < left <= SILENCE and passed.contact):
                continue
            amplitude = min(max(command.amplitude, 0.0), self._ceiling)
            if finger in self.fingers:
                powers[self.fingers.index(finger)] = amplitude
            if amplitude > pulse[0]:
                pulse[:] = amplitude, command.frequency, left
        return pulse, powers

    def _compute_fn(self, inputs: object, outputs: dict, context: object) -> None:
        outputs["pulse"][0], outputs["powers"][0] = self.values()
