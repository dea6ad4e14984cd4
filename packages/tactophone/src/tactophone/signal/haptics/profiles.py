"""Rendering profiles: which vibration a prediction is mapped to, and what an actuator
can play of it.

The paper's profile, the same graded within its classes, one fitted to perception, and
some for actuators that cannot play the paper's sines. All go from *smooth* (weak) to
*rough* (strong), so that a false bump is never stronger than a true one. A profile
takes no account of limits; :mod:`tactophone.signal.haptics.limits` scales and bounds
what it asks for.
"""

import itertools
import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Self

import numpy as np

from tactophone.core.errors import ConfigError, did_you_mean
from tactophone.core.settings import Settings
from tactophone.core.types import HapticCommand, Prediction, Profile, Touch
from tactophone.signal.haptics.grade import SMOOTH_GRADE, Grade
from tactophone.signal.haptics.psychophysics import amplitude_for, count_steps


@dataclass(frozen=True, slots=True)
class Stimulus:
    """The vibration at one end of the scale from smooth to rough."""

    frequency: float
    """In Hz."""
    level_dbfs: float
    """In dB of full drive."""


ROUGH_STIMULUS = Stimulus(60.0, 0.0)
"""The paper's authors describe it as *bumpy* (Pätzold et al. 2023, section III-D)."""

SMOOTH_STIMULUS = Stimulus(120.0, -25.0)
"""The paper's authors describe it as *fizzy*."""

SMOOTHEST_STIMULUS = Stimulus(217.0, -46.0)
"""The faintest stimulus of `GradedProfile`: about 11 dB fainter to a finger than the
paper's smooth."""


@dataclass(frozen=True, slots=True)
class PaperProfile:
    """The paper's rendering: a sine between *smooth* and *rough* by the detector's
    confidence; *none* is silence.

    The paper does not say how to interpolate. Here the level is interpolated in dB and
    the frequency by ratio, as both are perceived (Weber's law; steps of 18 % in
    frequency: Pongrac 2008): half way lies at 84.9 Hz and -12.5 dBFS.

    >>> undecided = Prediction((0.0, 0.5, 0.5), Touch.ROUGH, 0.5, -20.0, 0.0, 0.256)
    >>> command = PaperProfile().command(undecided)
    >>> round(command.frequency, 1), round(command.amplitude, 3)
    (84.9, 0.237)
    """

    smooth: Stimulus = SMOOTH_STIMULUS
    rough: Stimulus = ROUGH_STIMULUS
    name: str = "paper"

    def command(self, prediction: Prediction) -> HapticCommand:
        return self.between(prediction, prediction.roughness)

    def between(self, prediction: Prediction, share: float) -> HapticCommand:
        """Return the vibration at a share of the way from smooth (0) to rough (1);
        under 0 it is smoother yet."""
        ratio = self.rough.frequency / self.smooth.frequency
        frequency = self.smooth.frequency * ratio**share
        contrast_db = self.rough.level_dbfs - self.smooth.level_dbfs
        level_dbfs = self.smooth.level_dbfs + share * contrast_db
        return _vibration(prediction, 10 ** (level_dbfs / 20), frequency)


@dataclass(frozen=True, slots=True)
class GradedProfile(PaperProfile):
    """The paper's two stimuli, graded within a class: what is rougher is lower and
    stronger.

    It remembers the touch (`Grade`); each pipeline needs one of its own. Smooth ends at
    `SMOOTHEST_STIMULUS`.
    """

    name: str = "graded"
    grade: Grade = field(default_factory=Grade, repr=False, compare=False)

    def command(self, prediction: Prediction) -> HapticCommand:
        grade = self.grade.push(prediction)
        return self.between(prediction, (grade - SMOOTH_GRADE) / (1 - SMOOTH_GRADE))


def _vibration(
    prediction: Prediction, amplitude: float, frequency: float
) -> HapticCommand:
    """Return the vibration for a prediction, silent without contact; its time is the
    window's end."""
    return HapticCommand(
        0.0 if prediction.touch is Touch.NONE else amplitude, frequency, prediction.end
    )


_FORM = "wanted frequencies in Hz with levels in dB, rising, as in 40:-12,160:0,250:-6"


@dataclass(frozen=True, slots=True)
class ActuatorResponse:
    """An actuator's resonance, band, motor speeds and level by frequency; NaN or empty
    where unknown.

    >>> response = ActuatorResponse(lowest=80.0, levels=((80.0, -10.0), (160.0, 0.0)))
    >>> [round(response.level_db(hertz), 1) for hertz in (80.0, 113.137, 400.0)]
    [-10.0, -5.0, 0.0]
    >>> response.within(60.0), response.within(100.0)
    (80.0, 100.0)
    """

    resonance: float = math.nan
    """In Hz."""
    lowest: float = math.nan
    """Begin of the band in Hz, in which the level is at most 10 dB under the level at
    the resonance."""
    highest: float = math.nan
    """End of the band in Hz."""
    slowest: float = math.nan
    """Lowest speed, in Hz, at which a rotating motor turns."""
    fastest: float = math.nan
    """Speed of a rotating motor at full drive, in Hz."""
    levels: tuple[tuple[float, float], ...] = ()
    """``(frequency in Hz, level in dB relative to the resonance)``, frequencies
    rising."""

    def __post_init__(self) -> None:
        for low, high in ((self.lowest, self.highest), (self.slowest, self.fastest)):
            if low >= high:  # false for NaN
                raise ConfigError(
                    f"actuator: {low:g} to {high:g} Hz is no range; "
                    "wanted the lower figure first"
                )

    def level_db(self, frequency: float) -> float:
        """Return the level at a frequency, interpolated over the logarithm of
        frequency; 0 where unknown."""
        if not self.levels:
            return 0.0
        frequencies, levels = np.array(self.levels).T
        return float(np.interp(math.log(frequency), np.log(frequencies), levels))

    def within(self, frequency: float) -> float:
        """Return the frequency of the band that is nearest to one wanted."""
        lowest = known(self.lowest, -math.inf)
        highest = known(self.highest, math.inf)
        return min(max(frequency, lowest), highest)


UNKNOWN = ActuatorResponse()
"""Response of an actuator that was not measured: profiles then use typical figures."""


def known(value: float, typical: float) -> float:
    """Return a figure, or the typical one where it is NaN."""
    return typical if math.isnan(value) else value


MOST_HZ = 20_000.0
"""Highest frequency of a measured response: no actuator plays above it."""

MOST_DB = 200.0
"""Greatest level of a measured response, up or down: powers of ten stay finite."""


def parse_levels(text: str) -> tuple[tuple[float, float], ...]:
    """Parse levels written as ``40:-12,160:0``; `ConfigError` for another form, or
    frequencies that do not rise.

    >>> parse_levels("40:-12, 160:0")
    ((40.0, -12.0), (160.0, 0.0))
    """
    pairs = [entry.split(":") for entry in text.split(",") if entry.strip()]
    try:
        levels = tuple((float(frequency), float(level)) for frequency, level in pairs)
    except ValueError:
        raise ConfigError(f"actuator.response = {text!r}: {_FORM}") from None
    frequencies = [frequency for frequency, _ in levels]
    rising = all(low < high for low, high in itertools.pairwise([0.0, *frequencies]))
    # A comparison with NaN is false, so that NaN is refused too.
    bounded = all(
        frequency <= MOST_HZ and abs(level) <= MOST_DB for frequency, level in levels
    )
    if not (rising and bounded):
        raise ConfigError(f"actuator.response = {text!r}: {_FORM}")
    return levels


def actuator_response(settings: Settings) -> ActuatorResponse:
    """Return what the settings say of the actuator's response."""
    own = settings.actuator
    return ActuatorResponse(
        own.resonance,
        own.lowest,
        own.highest,
        own.slowest,
        own.fastest,
        parse_levels(own.response),
    )


@dataclass(frozen=True, slots=True)
class DualSenseProfile(GradedProfile):
    """The graded rendering on a DualSense's voice coils, moved into their band once it
    is measured.

    No figures of these coils are published. Until `tactophone devices measure` has
    written theirs, the two stimuli are the paper's; a band that begins above 60 Hz
    moves both up, an octave apart, so that the ratio that a finger discriminates
    remains.
    """

    name: str = "dualsense"

    @classmethod
    def fitted(cls, response: ActuatorResponse) -> Self:
        rough = response.within(ROUGH_STIMULUS.frequency)
        smooth = response.within(
            rough * SMOOTH_STIMULUS.frequency / ROUGH_STIMULUS.frequency
        )
        return cls(
            smooth=Stimulus(smooth, SMOOTH_STIMULUS.level_dbfs),
            rough=Stimulus(rough, ROUGH_STIMULUS.level_dbfs),
        )


@dataclass(frozen=True, slots=True)
class PerceptualProfile:
    """Spaces roughness evenly in just-noticeable steps of frequency and of level over
    threshold.

    Equal ratios of frequency are equal steps (Weber's law), and so are equal
    differences of level in dB; from high and faint (smooth) to low and strong (rough).
    The paper's 60 to 120 Hz hold 4 steps of frequency, this band 11.
    """

    lowest: float = 40.0
    """Begin of the actuator's measured band, in Hz, as far as a finger discriminates
    frequency in it."""
    highest: float = 250.0
    """End of that band, in Hz."""
    faint_db: float = 15.0
    """Level of smooth over the detection threshold."""
    strong_db: float = 33.0
    """Level of rough over the detection threshold: what full drive reaches at 40 Hz."""
    name: str = "perceptual"
    response: ActuatorResponse = UNKNOWN
    """The actuator's response, for which the level is corrected as far as full drive
    allows."""

    @classmethod
    def fitted(cls, response: ActuatorResponse) -> Self:
        """Make the profile for an actuator, in the part of the default band that it
        plays."""
        return cls(
            lowest=response.within(cls().lowest),
            highest=response.within(cls().highest),
            response=response,
        )

    def command(self, prediction: Prediction) -> HapticCommand:
        share = prediction.roughness
        frequency = self.highest * (self.lowest / self.highest) ** share
        level_db = self.faint_db + share * (self.strong_db - self.faint_db)
        drive_db = level_db - self.response.level_db(frequency)
        return _vibration(prediction, amplitude_for(drive_db, frequency), frequency)


@dataclass(frozen=True, slots=True)
class ErmProfile:
    """For an eccentric rotating mass (ERM), whose speed sets frequency and strength
    together.

    Its force grows with the square of its speed; under a starting voltage it does not
    turn. The figures describe a coin motor such as Precision Microdrives 310-103: about
    80 to 220 Hz.
    """

    slowest: float = 80.0
    """Lowest speed at which it turns, in Hz."""
    fastest: float = 220.0
    """Speed at full drive, in Hz."""
    name: str = "erm"
    grade: Grade = field(default_factory=Grade, repr=False, compare=False)

    @classmethod
    def fitted(cls, response: ActuatorResponse) -> Self:
        return cls(
            slowest=known(response.slowest, cls().slowest),
            fastest=known(response.fastest, cls().fastest),
        )

    def command(self, prediction: Prediction) -> HapticCommand:
        """Return the vibration that the motor makes; drive it by ``frequency /
        fastest``."""
        share = self.grade.push(prediction)
        frequency = self.slowest + share * (self.fastest - self.slowest)
        return _vibration(prediction, (frequency / self.fastest) ** 2, frequency)


@dataclass(frozen=True, slots=True)
class LraProfile:
    """For a linear resonant actuator (LRA), which moves at its resonance alone: only
    the level carries roughness."""

    resonance: float = 175.0
    """In Hz; 150 to 235 by manufacturer. At 10 Hz beside it the force is half or
    less."""
    faint_db: float = -25.0
    """Level of smooth, in dB of full drive."""
    name: str = "lra"
    grade: Grade = field(default_factory=Grade, repr=False, compare=False)

    @classmethod
    def fitted(cls, response: ActuatorResponse) -> Self:
        return cls(resonance=known(response.resonance, cls().resonance))

    def command(self, prediction: Prediction) -> HapticCommand:
        level_dbfs = self.faint_db * (1 - self.grade.push(prediction))
        return _vibration(prediction, 10 ** (level_dbfs / 20), self.resonance)


@dataclass(frozen=True, slots=True)
class PiezoProfile:
    """For a piezo bender: a spring, so its travel follows the voltage up to the
    resonance, and its force the square of the frequency: 12 dB less an octave lower.

    Smooth is faint at the resonance, rough is full drive an octave below it. There the
    bender gives 12 dB less, so smooth is rendered another 12 dB lower: what reaches the
    finger differs by 25 dB, as in the paper.
    """

    resonance: float = 200.0
    """In Hz; the default is assumed, as benders differ widely: measure it."""
    faint_db: float = -25.0 - 12.0
    """Level of smooth, in dB of full drive."""
    name: str = "piezo"
    grade: Grade = field(default_factory=Grade, repr=False, compare=False)

    @classmethod
    def fitted(cls, response: ActuatorResponse) -> Self:
        return cls(resonance=known(response.resonance, cls().resonance))

    def command(self, prediction: Prediction) -> HapticCommand:
        share = self.grade.push(prediction)
        amplitude = 10 ** (self.faint_db * (1 - share) / 20)
        return _vibration(prediction, amplitude, self.resonance * 2**-share)


CLICK_DURATION = 0.03
"""Seconds; a shorter burst is not felt as vibration (Sci. Rep. 2025, 15:5057)."""

CLICK_FREQUENCY = 250.0
"""Hz; where the skin is most sensitive (Verrillo 1963)."""

CLICKS = frozenset({"contact"})
"""Events that click: the onset, which is known within 5 ms. Whether it was a tap is
known 25 ms later."""


class EventsProfile:
    """Adds a click to another profile at each onset of a touch.

    It remembers when the click began; each pipeline needs one of its own. Without an
    event detector in the pipeline it renders as the other profile does.
    """

    name = "events"

    def __init__(self, base: Profile) -> None:
        self._base = base
        self._clicked = -math.inf

    def command(self, prediction: Prediction) -> HapticCommand:
        """Return the vibration for a prediction; full amplitude for the length of a
        click."""
        if any(event.kind in CLICKS for event in prediction.events):
            self._clicked = prediction.end
        # Time may begin anew, where a stream is restarted.
        clicks = 0 <= prediction.end - self._clicked < CLICK_DURATION
        if clicks and not prediction.faulty:
            return HapticCommand(1.0, CLICK_FREQUENCY, prediction.end)
        return self._base.command(prediction)


PROFILES: Mapping[str, Callable[[ActuatorResponse], Profile]] = {
    "graded": lambda response: GradedProfile(),
    "paper": lambda response: PaperProfile(),
    "perceptual": PerceptualProfile.fitted,
    "erm": ErmProfile.fitted,
    "lra": LraProfile.fitted,
    "piezo": PiezoProfile.fitted,
    "dualsense": DualSenseProfile.fitted,
    "events": lambda response: EventsProfile(GradedProfile()),
}
"""Makes each profile for an actuator, by the name that ``feel --profile`` takes."""


def open_profile(name: str, response: ActuatorResponse = UNKNOWN) -> Profile:
    """Make the profile of a name, for an actuator.

    The profile ``paper`` is the paper's whatever the actuator.

    Raises
    ------
    ConfigError
        If there is no profile of that name.
    """
    if name in PROFILES:
        return PROFILES[name](response)
    hint = did_you_mean(name, PROFILES)
    raise ConfigError(
        f"no rendering profile {name!r}; there are {', '.join(PROFILES)}{hint}"
    )


_PATH = 200
"""Steps of roughness from smooth to rough, dense enough to add up a profile's curve."""


def discriminable_steps(profile: Profile) -> tuple[float, float]:
    """Count the just-noticeable steps between a profile's smooth and rough: of
    frequency alone, and in all."""
    stimuli = []
    for place in range(_PATH + 1):
        roughness = place / _PATH
        touch = Touch.ROUGH if roughness >= 0.5 else Touch.SMOOTH
        command = profile.command(
            Prediction((0.0, 1 - roughness, roughness), touch, roughness, 0.0, 0.0, 0.0)
        )
        stimuli.append((command.amplitude, command.frequency))
    return count_steps(stimuli)
