"""Simulated people: an operator who explores stones, a participant who follows instructions."""
