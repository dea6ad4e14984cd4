"""Recordings through the pipeline: vibration, timeline and figure on disk. What `tactophone feel` runs."""
