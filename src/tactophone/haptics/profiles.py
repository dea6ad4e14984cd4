"""Rendering profiles beside the paper's: one fitted to perception, and three for actuators that cannot play its sines.

All go from *smooth* (weak) to *rough* (strong), so that a false bump is never stronger than a true one.
"""

from dataclasses import dataclass
from typing import Self

from tactophone.haptics.psychophysics import amplitude_for, count_steps
from tactophone.haptics.response import UNKNOWN, ActuatorResponse, known
from tactophone.types import HapticCommand, Prediction, Profile, Touch

_PATH = 200


@dataclass(frozen=True, slots=True)
class PerceptualProfile:
    """Spaces roughness evenly in just-noticeable steps of frequency and of level over threshold.

    Equal ratios of frequency are equal steps (Weber's law), and so are equal differences of level in dB; from high
    and faint (smooth) to low and strong (rough). The paper's 60 to 120 Hz hold 4 steps of frequency, this band 11.
    """

    lowest: float = 40.0
    highest: float = 250.0
    """`lowest` and `highest`: the actuator's measured band, in Hz, as far as a finger discriminates frequency in it."""
    faint_db: float = 15.0
    strong_db: float = 33.0
    """`faint_db` and `strong_db`: levels over threshold; 33 dB is what full drive reaches at 40 Hz."""
    name: str = "perceptual"
    response: ActuatorResponse = UNKNOWN
    """Of the actuator: its level at a frequency is compensated as far as full drive allows."""

    @classmethod
    def fitted(cls, response: ActuatorResponse) -> Self:
        """Make the profile for an actuator, in the part of the default band that it plays."""
        return cls(lowest=response.within(cls().lowest), highest=response.within(cls().highest), response=response)

    def command(self, prediction: Prediction) -> HapticCommand:
        """Return the vibration for a prediction; its time is the window's end."""
        share = prediction.roughness
        frequency = self.highest * (self.lowest / self.highest) ** share
        if prediction.touch is Touch.NONE:
            return HapticCommand(0.0, frequency, prediction.end)
        level_db = self.faint_db + share * (self.strong_db - self.faint_db)
        drive_db = level_db - self.response.level_db(frequency)
        return HapticCommand(amplitude_for(drive_db, frequency), frequency, prediction.end)


@dataclass(frozen=True, slots=True)
class ErmProfile:
    """For an eccentric rotating mass (ERM), whose speed sets frequency and strength together.

    Its force grows with the square of its speed; under a starting voltage it does not turn. The figures are those of
    a coin motor such as Precision Microdrives 310-103: about 80 to 220 Hz.
    """

    slowest: float = 80.0
    fastest: float = 220.0
    """`slowest` and `fastest`: speeds in Hz: the lowest at which it turns, and that at full drive."""
    name: str = "erm"

    @classmethod
    def fitted(cls, response: ActuatorResponse) -> Self:
        """Make the profile for a motor's speeds."""
        return cls(slowest=known(response.slowest, cls().slowest), fastest=known(response.fastest, cls().fastest))

    def command(self, prediction: Prediction) -> HapticCommand:
        """Return the vibration that the motor makes; drive it by ``frequency / fastest``."""
        share = 0.0 if prediction.touch is Touch.NONE else prediction.roughness
        frequency = self.slowest + share * (self.fastest - self.slowest)
        amplitude = 0.0 if prediction.touch is Touch.NONE else (frequency / self.fastest) ** 2
        return HapticCommand(amplitude, frequency, prediction.end)


@dataclass(frozen=True, slots=True)
class LraProfile:
    """For a linear resonant actuator (LRA), which moves at its resonance alone: only the level carries roughness."""

    resonance: float = 175.0
    """In Hz; 150 to 235 by manufacturer. At 10 Hz beside it the force is half or less."""
    faint_db: float = -25.0
    """Level of smooth, in dB of full drive."""
    name: str = "lra"

    @classmethod
    def fitted(cls, response: ActuatorResponse) -> Self:
        """Make the profile for an actuator's resonance."""
        return cls(resonance=known(response.resonance, cls().resonance))

    def command(self, prediction: Prediction) -> HapticCommand:
        """Return the vibration for a prediction; its time is the window's end."""
        if prediction.touch is Touch.NONE:
            return HapticCommand(0.0, self.resonance, prediction.end)
        level_db = self.faint_db * (1 - prediction.roughness)
        return HapticCommand(10 ** (level_db / 20), self.resonance, prediction.end)


@dataclass(frozen=True, slots=True)
class PiezoProfile:
    """For a piezo bender: a spring, so its travel follows the voltage up to the resonance, and its force the square of
    the frequency: 12 dB less an octave lower.

    Smooth is faint at the resonance, rough is full drive an octave below it. There the bender gives 12 dB less, so
    smooth is rendered another 12 dB lower: what reaches the finger differs by 25 dB, as in the paper.
    """

    resonance: float = 200.0
    """In Hz; the default is assumed, as benders differ widely: measure it."""
    faint_db: float = -25.0 - 12.0
    """Level of smooth, in dB of full drive."""
    name: str = "piezo"

    @classmethod
    def fitted(cls, response: ActuatorResponse) -> Self:
        """Make the profile for an actuator's resonance."""
        return cls(resonance=known(response.resonance, cls().resonance))

    def command(self, prediction: Prediction) -> HapticCommand:
        """Return the vibration for a prediction; its time is the window's end."""
        frequency = self.resonance * 2**-prediction.roughness
        if prediction.touch is Touch.NONE:
            return HapticCommand(0.0, frequency, prediction.end)
        return HapticCommand(10 ** (self.faint_db * (1 - prediction.roughness) / 20), frequency, prediction.end)


def discriminable_steps(profile: Profile) -> tuple[float, float]:
    """Count the just-noticeable steps between a profile's smooth and rough: of frequency alone, and in all."""
    stimuli = []
    for place in range(_PATH + 1):
        roughness = place / _PATH
        touch = Touch.ROUGH if roughness >= 0.5 else Touch.SMOOTH
        command = profile.command(Prediction((0.0, 1 - roughness, roughness), touch, roughness, 0.0, 0.0, 0.0))
        stimuli.append((command.amplitude, command.frequency))
    return count_steps(stimuli)
