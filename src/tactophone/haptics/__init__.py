"""Belief to feel: mapping, limits, oscillator, actuator."""
