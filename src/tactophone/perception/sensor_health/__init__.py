"""Microphone faults, the fallback for each, and the calibration of a set-up."""
