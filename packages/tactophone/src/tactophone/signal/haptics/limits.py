"""Bounds of the vibration that no sound, model, page or programming error can exceed.

They are applied several times over. The pipeline scales a profile to the ceiling and
bounds each command, so that what is shown is what is rendered. The renderer, in the
process that drives the actuator, bounds the command again and clips the waveform, so
that nothing between the two needs to be trusted. The ramp of the vibration, and the
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
        Begin of the band in Hz; by default the paper's voice coil's, a Lofelt Basslet
        (section IV-B).
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
        # A comparison with NaN is false, so that NaN is refused too.
        valid_ceiling = 0 <= self.ceiling <= 1
        valid_band = 0 < self.lowest <= self.highest < math.inf
        if not (valid_ceiling and valid_band):
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
        if peak <= 0:
            return 1.0
        return min(1.0, self.ceiling / peak)

    def bound(self, command: HapticCommand) -> HapticCommand:
        """Return the nearest command within the bounds; silence for one that is not
        finite (see :func:`is_finite`)."""
        if not is_finite(command):
            return HapticCommand(0.0, self.lowest, command.time)
        # The ceiling is read once, as another thread may lower it meanwhile.
        amplitude = min(max(command.amplitude, 0.0), self.ceiling)
        frequency = min(max(command.frequency, self.lowest), self.highest)
        if (amplitude, frequency) == (command.amplitude, command.frequency):
            return command
        return HapticCommand(amplitude, frequency, command.time)


def is_finite(command: HapticCommand) -> bool:
    """Return whether amplitude and frequency are finite; infinity is a fault, not a
    strong vibration."""
    return math.isfinite(command.amplitude) and math.isfinite(command.frequency)


def peak_amplitude(profile: Profile) -> float:
    """Return the greatest finite amplitude, 0 to 1, that a profile asks for between
    smooth and rough.

    It is found by trying, so that a profile need not declare it: 101 values of
    roughness for either touch, ends included.
    """
    amplitudes = []
    for touch in SURFACE_LABELS:
        for step in range(101):
            roughness = step / 100
            probabilities = (0.0, 1.0 - roughness, roughness)
            command = profile.command(
                Prediction(probabilities, touch, roughness, 0.0, 0.0, 0.0)
            )
            if is_finite(command):
                amplitudes.append(min(command.amplitude, 1.0))
    return max(amplitudes, default=0.0)
