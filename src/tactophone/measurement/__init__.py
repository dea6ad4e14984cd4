"""Measurements of the running system: impulse latency, time to silence after a failure, decision delay."""
