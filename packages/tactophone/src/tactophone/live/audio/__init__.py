"""Microphones, actuators and recordings: sound in, vibration out."""
