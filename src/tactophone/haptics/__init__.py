"""Belief to feel: mapping, limits, oscillator, actuator."""

from tactophone.haptics.actuator import Actuator, clocked_actuator, jack_actuator, portaudio_actuator

__all__ = ["Actuator", "clocked_actuator", "jack_actuator", "portaudio_actuator"]
