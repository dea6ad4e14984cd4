"""Bridges from a run to other systems: logs, live viewers, robot middleware, haptic
formats."""
