"""Rendering profiles by name: which vibration a prediction is mapped to.

A profile takes no account of limits; :mod:`tactophone.haptics.limits` scales and bounds what it asks for.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Self

from tactophone.errors import ConfigError, did_you_mean
from tactophone.haptics.event_profile import EventsProfile
from tactophone.haptics.profiles import ErmProfile, LraProfile, PerceptualProfile, PiezoProfile
from tactophone.haptics.response import UNKNOWN, ActuatorResponse
from tactophone.types import HapticCommand, Prediction, Profile, Touch


@dataclass(frozen=True, slots=True)
class Stimulus:
    """The vibration at one end of the scale from smooth to rough."""

    frequency: float
    """In Hz."""
    level_dbfs: float
    """In dB of full drive."""


ROUGH_STIMULUS = Stimulus(60.0, 0.0)
"""Users called it *bumpy* (Pätzold et al. 2023, section III-D)."""

SMOOTH_STIMULUS = Stimulus(120.0, -25.0)
"""Users called it *fizzy* (ibid.)."""


@dataclass(frozen=True, slots=True)
class PaperProfile:
    """The paper's rendering: a sine between *smooth* and *rough* by the detector's confidence; *none* is silence.

    The paper does not say how to interpolate. Here the level is interpolated in dB and the frequency by ratio, as both
    are perceived (Weber's law; steps of 18 % in frequency: Pongrac 2008): half way lies at 84.9 Hz and -12.5 dBFS.

    Examples
    --------
    >>> prediction = Prediction((0.0, 0.5, 0.5), Touch.ROUGH, roughness=0.5, level_dbfs=-20.0, start=0.0, end=0.256)
    >>> command = PaperProfile().command(prediction)
    >>> round(command.frequency, 1), round(command.amplitude, 3)
    (84.9, 0.237)
    """

    smooth: Stimulus = SMOOTH_STIMULUS
    rough: Stimulus = ROUGH_STIMULUS
    name: str = "paper"

    def command(self, prediction: Prediction) -> HapticCommand:
        """Return the vibration for a prediction; its time is the window's end."""
        roughness = prediction.roughness
        frequency = self.smooth.frequency * (self.rough.frequency / self.smooth.frequency) ** roughness
        if prediction.touch is Touch.NONE:
            return HapticCommand(0.0, frequency, prediction.end)
        level_dbfs = self.smooth.level_dbfs + roughness * (self.rough.level_dbfs - self.smooth.level_dbfs)
        return HapticCommand(10 ** (level_dbfs / 20), frequency, prediction.end)


@dataclass(frozen=True, slots=True)
class DualSenseProfile(PaperProfile):
    """The paper's rendering on a DualSense's voice coils, moved into their band once it is measured.

    No figures of these coils are published. Until `tactophone devices measure` has written theirs, the two stimuli are
    the paper's; a band that begins above 60 Hz moves both up, an octave apart, so that the ratio that a finger
    discriminates remains.
    """

    name: str = "dualsense"

    @classmethod
    def fitted(cls, response: ActuatorResponse) -> Self:
        """Make the profile for a measured band."""
        rough = response.within(ROUGH_STIMULUS.frequency)
        smooth = response.within(rough * SMOOTH_STIMULUS.frequency / ROUGH_STIMULUS.frequency)
        return cls(
            smooth=Stimulus(smooth, SMOOTH_STIMULUS.level_dbfs), rough=Stimulus(rough, ROUGH_STIMULUS.level_dbfs)
        )


_FITTED: Mapping[str, Callable[[ActuatorResponse], Profile]] = MappingProxyType(
    {
        "perceptual": PerceptualProfile.fitted,
        "erm": ErmProfile.fitted,
        "lra": LraProfile.fitted,
        "piezo": PiezoProfile.fitted,
        "dualsense": DualSenseProfile.fitted,
    }
)

PROFILES: Mapping[str, Callable[[], Profile]] = MappingProxyType(
    {
        "paper": PaperProfile,
        "perceptual": PerceptualProfile,
        "erm": ErmProfile,
        "lra": LraProfile,
        "piezo": PiezoProfile,
        "dualsense": DualSenseProfile,
        "events": lambda: EventsProfile(PaperProfile()),
    }
)
"""Every profile by the name that ``feel --profile`` takes."""


def open_profile(name: str, response: ActuatorResponse = UNKNOWN) -> Profile:
    """Make the profile of a name, for an actuator.

    The profile ``paper`` is the paper's whatever the actuator.

    Raises
    ------
    ConfigError
        If there is no profile of that name.
    """
    if name in PROFILES:
        return _FITTED[name](response) if name in _FITTED else PROFILES[name]()
    hint = did_you_mean(name, PROFILES)
    raise ConfigError(f"no rendering profile {name!r}; there are {', '.join(PROFILES)}{hint}")
