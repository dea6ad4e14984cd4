"""Belief to feel: mapping, limits, oscillator, actuator."""

from tactophone.haptics.actuator import Actuator, clocked_actuator, jack_actuator, portaudio_actuator
from tactophone.haptics.limits import Limits
from tactophone.haptics.mapping import PROFILES, PaperProfile, open_profile
from tactophone.haptics.oscillator import Oscillator
from tactophone.haptics.playback import Playback
from tactophone.haptics.profiles import ErmProfile, LraProfile, PerceptualProfile, discriminable_steps
from tactophone.haptics.relay import Opening, Relay
from tactophone.haptics.sounding import SOUNDING, Sounding

__all__ = [
    "PROFILES",
    "SOUNDING",
    "Actuator",
    "ErmProfile",
    "Limits",
    "LraProfile",
    "Opening",
    "Oscillator",
    "PaperProfile",
    "PerceptualProfile",
    "Playback",
    "Relay",
    "Sounding",
    "clocked_actuator",
    "discriminable_steps",
    "jack_actuator",
    "open_profile",
    "portaudio_actuator",
]
