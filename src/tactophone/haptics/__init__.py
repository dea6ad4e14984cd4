"""Belief to feel: mapping, limits, oscillator, actuator."""

from tactophone.haptics.actuator import Actuator, clocked_actuator, jack_actuator, portaudio_actuator
from tactophone.haptics.limits import Limits
from tactophone.haptics.mapping import PROFILES, PaperProfile, open_profile
from tactophone.haptics.oscillator import Oscillator
from tactophone.haptics.playback import Playback

__all__ = [
    "PROFILES",
    "Actuator",
    "Limits",
    "Oscillator",
    "PaperProfile",
    "Playback",
    "clocked_actuator",
    "jack_actuator",
    "open_profile",
    "portaudio_actuator",
]
