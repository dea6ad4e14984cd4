"""What may be felt at all: bounds that no sound, model, page or programming slip can pass.

They hold twice: the walk bounds each command, so that what is shown is what is felt; and the oscillator bounds it
again in the process that drives the finger, so that nothing between the two needs to be trusted.
"""

import math
from dataclasses import dataclass

from tactophone.types import HapticCommand


@dataclass(frozen=True, slots=True)
class Limits:
    """Bounds of the vibration.

    Parameters
    ----------
    ceiling
        Greatest amplitude, 0 to 1 of full drive.
    lowest, highest
        The band in Hz; the defaults are those of the paper's voice coil, a Lofelt Basslet (section III-D).
    settling
        Time constant, in s, of the low-pass on amplitude and frequency. It bounds the slew: an amplitude never moves
        faster than ``1 / settling`` of full drive a second.
    patience
        Longest time, in s, that a vibration outlives its last command, before it fades.

    Examples
    --------
    >>> Limits(ceiling=0.5).bound(HapticCommand(3.0, 5.0, time=0.0))
    HapticCommand(amplitude=0.5, frequency=35.0, time=0.0)
    >>> Limits().bound(HapticCommand(float("nan"), 60.0, time=0.0)).amplitude
    0.0
    """

    ceiling: float = 1.0
    lowest: float = 35.0
    highest: float = 1000.0
    # 4 ms: far under the 30 ms of the shortest burst that is felt, and soft enough that nothing clicks. An amplitude
    # falls to exact silence in 12 time constants, 48 ms.
    settling: float = 0.004
    # 35 ms is three missed hops of 10.67 ms: on its way down within 40 ms, and silent within 35 + 48 < 100 ms.
    patience: float = 0.035

    def __post_init__(self) -> None:
        bounds = (self.ceiling, self.lowest, self.highest, self.settling, self.patience)
        sound = all(map(math.isfinite, bounds)) and 0 <= self.ceiling <= 1 and min(self.settling, self.patience) > 0
        if not sound or not 0 < self.lowest <= self.highest:
            raise ValueError(f"{self}: wanted 0 <= ceiling <= 1, 0 < lowest <= highest, and times over 0")

    def bound(self, command: HapticCommand) -> HapticCommand:
        """Give the nearest command that is allowed; silence for one that is no number (see :func:`is_sound`)."""
        if not is_sound(command):
            return HapticCommand(0.0, self.lowest, command.time)
        if 0.0 <= command.amplitude <= self.ceiling and self.lowest <= command.frequency <= self.highest:
            return command
        amplitude = min(max(command.amplitude, 0.0), self.ceiling)
        return HapticCommand(amplitude, min(max(command.frequency, self.lowest), self.highest), command.time)


def is_sound(command: HapticCommand) -> bool:
    """Whether a command's amplitude and frequency are numbers; an infinite one is a fault, not a loud wish."""
    return math.isfinite(command.amplitude) and math.isfinite(command.frequency)
