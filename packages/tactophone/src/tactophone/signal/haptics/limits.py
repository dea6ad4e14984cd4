"""Bounds of the vibration that no sound, model, page or programming error can exceed.

They are applied twice: the pipeline bounds each command, so that what is shown is what
is rendered, and the oscillator bounds it again in the process that drives the actuator,
so that nothing between the two needs to be trusted. The ramp of the vibration, and the
time after which a stale command fades, are the oscillator's.
"""

import math
from dataclasses import dataclass, field

from tactophone.core.settings import DEFAULT_CEILING
from tactophone.core.types import SURFACE_LABELS, HapticCommand, Prediction, Profile


@dataclass(slots=True)
class Limits:
    """Bounds of the vibration.

    Parameters
    ----------
    ceiling
        Greatest amplitude, 0 to 1 of full drive. It may be assigned at any time, by any
        thread: gate, pipeline and renderer of a finger share one object, so that each
        applies the same ceiling from then on.
    lowest
        Begin of the band in Hz; by default that of the paper's voice coil, a Lofelt
        Basslet (section IV-B).
    highest
        End of the band in Hz.
    machine
        The greatest ceiling of this machine, by default the one given. A waveform above
        it is cut at once; one above a ceiling that was lowered since falls as smoothly
        as any other.

    Examples
    --------
    >>> Limits().bound(HapticCommand(3.0, 5.0, time=0.0))
    HapticCommand(amplitude=0.5, frequency=35.0, time=0.0)
    >>> Limits().bound(HapticCommand(float("nan"), 60.0, time=0.0)).amplitude
    0.0
    """

    ceiling: float = DEFAULT_CEILING
    lowest: float = 35.0
    highest: float = 1000.0
    machine: float = field(default=0.0, repr=False)

    def __post_init__(self) -> None:
        self.machine = max(self.machine, self.ceiling)
        if not (
            0 <= self.ceiling <= 1 and 0 < self.lowest <= self.highest < math.inf
        ):  # also where one is NaN
            raise ValueError(
                f"{self}: wanted 0 <= ceiling <= 1 and 0 < lowest <= highest"
            )

    def scale_for(self, peak: float) -> float:
        """Return the factor that brings a profile's greatest amplitude ``peak`` down to
        the ceiling; at most 1.

        The factor applies to the whole profile. Bounding its strong end alone would
        reduce the contrast between rough and smooth: from 25 to 19 dB for the paper's
        profile under a ceiling of 0.5.

        >>> Limits(ceiling=0.5).scale_for(1.0), Limits(ceiling=0.5).scale_for(0.2)
        (0.5, 1.0)
        """
        return min(1.0, self.ceiling / peak) if peak > 0 else 1.0

    def bound(self, command: HapticCommand) -> HapticCommand:
        """Return the nearest command within the bounds; silence for one that is not
        finite (see :func:`is_finite`)."""
        if not is_finite(command):
            return HapticCommand(0.0, self.lowest, command.time)
        if (
            0.0 <= command.amplitude <= self.ceiling
            and self.lowest <= command.frequency <= self.highest
        ):
            return command
        amplitude = min(max(command.amplitude, 0.0), self.ceiling)
        return HapticCommand(
            amplitude,
            min(max(command.frequency, self.lowest), self.highest),
            command.time,
        )


def is_finite(command: HapticCommand) -> bool:
    """Whether amplitude and frequency are finite; an infinite one is a fault, not a
    strong vibration."""
    return math.isfinite(command.amplitude) and math.isfinite(command.frequency)


def peak_amplitude(profile: Profile) -> float:
    """Return the greatest finite amplitude, 0 to 1, that a profile asks for between
    smooth and rough.

    Found by trying 101 values of roughness for either touch, ends included, so that a
    profile need not declare it.
    """
    commands = (
        profile.command(
            Prediction(
                (0.0, 1.0 - roughness, roughness), touch, roughness, 0.0, 0.0, 0.0
            )
        )
        for touch in SURFACE_LABELS
        for roughness in (step / 100 for step in range(101))
    )
    return max(
        (min(command.amplitude, 1.0) for command in commands if is_finite(command)),
        default=0.0,
    )
