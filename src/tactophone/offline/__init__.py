"""Recordings through the pipeline: vibration, timeline and plots on disk. What `feel` runs."""
