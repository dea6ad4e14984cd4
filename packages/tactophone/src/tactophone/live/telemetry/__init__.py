"""Telemetry of a run: recent sound, pipeline steps, predictions, counters and state,
and the log of predictions."""
