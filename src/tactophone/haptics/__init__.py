"""Prediction to vibration: rendering profiles, limits, renderers and actuators."""

from tactophone.haptics.actuator import (
    Actuator,
    RenderHand,
    clocked_hand_actuator,
    gamepad_actuator,
    jack_hand_actuator,
    portaudio_hand_actuator,
)
from tactophone.haptics.limits import Limits, peak_amplitude
from tactophone.haptics.oscillator import Oscillator, Playback, Renderer
from tactophone.haptics.passthrough import PASSTHROUGH, STEP_SIZE, GateProfile, Passthrough, PassthroughRenderer
from tactophone.haptics.profiles import (
    PROFILES,
    ROUGH_STIMULUS,
    SMOOTH_STIMULUS,
    UNKNOWN,
    ActuatorResponse,
    PaperProfile,
    PerceptualProfile,
    Stimulus,
    discriminable_steps,
    open_profile,
    parse_levels,
)
from tactophone.haptics.psychophysics import FULL_DRIVE_DB, LEVEL_JND_DB, PITCH_JND, threshold_db

__all__ = [
    "FULL_DRIVE_DB",
    "LEVEL_JND_DB",
    "PASSTHROUGH",
    "PITCH_JND",
    "PROFILES",
    "ROUGH_STIMULUS",
    "SMOOTH_STIMULUS",
    "STEP_SIZE",
    "UNKNOWN",
    "Actuator",
    "ActuatorResponse",
    "GateProfile",
    "Limits",
    "Oscillator",
    "PaperProfile",
    "Passthrough",
    "PassthroughRenderer",
    "PerceptualProfile",
    "Playback",
    "RenderHand",
    "Renderer",
    "Stimulus",
    "clocked_hand_actuator",
    "discriminable_steps",
    "gamepad_actuator",
    "jack_hand_actuator",
    "open_profile",
    "parse_levels",
    "peak_amplitude",
    "portaudio_hand_actuator",
    "threshold_db",
]
