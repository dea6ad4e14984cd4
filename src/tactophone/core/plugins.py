"""Detectors, actuators and ROS devices of other packages, as entry points in their
``pyproject.toml``."""

import importlib.metadata
from typing import Any

DETECTORS = "tactophone.detectors"
"""Entry points called with ``sample_rate`` and ``channels``; each returns a
`tactophone.core.types.Detector`."""

ACTUATORS = "tactophone.actuators"
"""Entry points called with ``render``, ``fingers`` and ``device``; each returns an
actuator (`tactophone.live.audio.actuator`)."""

ROS_SINKS = "tactophone.ros_sinks"
"""Entry points called with the names of the fingers; each returns a
`tactophone.faces.bridges.ros_topics.Sink`."""


def registered(group: str) -> list[str]:
    """Return the names that other packages have registered in a group."""
    return sorted(point.name for point in importlib.metadata.entry_points(group=group))


def load(group: str, name: str) -> Any:
    """Return what is registered under a name; ``None`` if nothing is."""
    points = importlib.metadata.entry_points(group=group, name=name)
    return next(iter(points)).load() if points else None
