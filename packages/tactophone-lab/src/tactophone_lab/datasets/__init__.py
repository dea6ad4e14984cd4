"""Data sets: recordings, their labels, checks, splits and conversion."""
