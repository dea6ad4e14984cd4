"""Belief to wish: which vibration a prediction asks for, by a rendering profile that has a name.

A profile knows nothing of limits: what is wished for here is bounded by :mod:`tactophone.haptics.limits`.
"""

import difflib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType

from tactophone.errors import ConfigError
from tactophone.haptics.profiles import ErmProfile, LraProfile, PerceptualProfile
from tactophone.types import HapticCommand, Prediction, Profile, Touch


@dataclass(frozen=True, slots=True)
class Stimulus:
    """A vibration that stands for one end of the scale.

    Parameters
    ----------
    frequency
        In Hz.
    level_dbfs
        In dB of full drive.
    """

    frequency: float
    level_dbfs: float


ROUGH = Stimulus(60.0, 0.0)
"""Users call it *bumpy* (Pätzold et al. 2023, section III-D)."""

SMOOTH = Stimulus(120.0, -25.0)
"""Users call it *fizzy* (ibid.)."""


@dataclass(frozen=True, slots=True)
class PaperProfile:
    """The paper's feel: a sine, moved by the detector's confidence between *smooth* and *rough*; none is silence.

    The paper does not say along which line the confidence moves it. Here the level moves in dB and the frequency by
    ratio, as both are felt (Weber's law; steps of 18 % in frequency: Pongrac 2008): half way lies at 84.9 Hz and
    -12.5 dBFS.

    Examples
    --------
    >>> belief = Prediction((0.0, 0.5, 0.5), Touch.ROUGH, roughness=0.5, level_dbfs=-20.0, start=0.0, end=0.256)
    >>> command = PaperProfile().command(belief)
    >>> round(command.frequency, 1), round(command.amplitude, 3)
    (84.9, 0.237)
    """

    smooth: Stimulus = SMOOTH
    rough: Stimulus = ROUGH
    name: str = "paper"

    def command(self, prediction: Prediction) -> HapticCommand:
        """Give the vibration wished for; its time is the window's end."""
        share = prediction.roughness
        frequency = self.smooth.frequency * (self.rough.frequency / self.smooth.frequency) ** share
        if prediction.touch is Touch.NONE:
            return HapticCommand(0.0, frequency, prediction.end)
        level_dbfs = self.smooth.level_dbfs + share * (self.rough.level_dbfs - self.smooth.level_dbfs)
        return HapticCommand(10 ** (level_dbfs / 20), frequency, prediction.end)


PROFILES: Mapping[str, Callable[[], Profile]] = MappingProxyType(
    {"paper": PaperProfile, "perceptual": PerceptualProfile, "erm": ErmProfile, "lra": LraProfile}
)
"""Every profile by the name that ``feel --profile`` takes."""


def open_profile(name: str) -> Profile:
    """Make a profile by its name.

    Raises
    ------
    ConfigError
        If there is none of that name.
    """
    if name in PROFILES:
        return PROFILES[name]()
    nearest = difflib.get_close_matches(name, PROFILES, n=1)
    hint = f"; did you mean {nearest[0]}?" if nearest else ""
    raise ConfigError(f"no rendering profile {name!r}; there are {', '.join(PROFILES)}{hint}")
