"""Measurements of the running system: impulse latency, fail-safe timing, decision delay."""
