"""Prediction to vibration: rendering profiles, limits, renderers and actuators."""
