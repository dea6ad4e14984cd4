"""Belief to feel: mapping, limits, oscillator, actuator."""

from tactophone.haptics.actuator import Actuator, clocked_actuator, jack_actuator, portaudio_actuator
from tactophone.haptics.limits import Limits
from tactophone.haptics.mapping import PROFILES, PaperProfile, open_profile
from tactophone.haptics.oscillator import Oscillator
from tactophone.haptics.passthrough import PASSTHROUGH, Passthrough
from tactophone.haptics.passthrough_renderer import GateProfile, PassthroughRenderer
from tactophone.haptics.playback import Playback
from tactophone.haptics.profiles import ErmProfile, LraProfile, PerceptualProfile, discriminable_steps

__all__ = [
    "PASSTHROUGH",
    "PROFILES",
    "Actuator",
    "ErmProfile",
    "GateProfile",
    "Limits",
    "LraProfile",
    "Oscillator",
    "PaperProfile",
    "Passthrough",
    "PassthroughRenderer",
    "PerceptualProfile",
    "Playback",
    "clocked_actuator",
    "discriminable_steps",
    "jack_actuator",
    "open_profile",
    "portaudio_actuator",
]
