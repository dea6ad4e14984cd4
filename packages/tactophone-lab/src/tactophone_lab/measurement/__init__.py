"""Measurements of the running system: impulse latency, decision delay, what an actuator
plays."""
