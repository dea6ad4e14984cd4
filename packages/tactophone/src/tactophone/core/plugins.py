"""What other packages add, as entry points in their ``pyproject.toml``: verbs, sources,
detectors, passthroughs, actuators and ROS devices."""

import importlib.metadata
from typing import Any

VERBS = "tactophone.verbs"
"""Entry points that are sequences of `tactophone.cli.verbs.Verb`."""

SOURCES = "tactophone.sources"
"""Entry points called with `tactophone.core.settings.Settings`; each returns a
`tactophone.core.types.Source` at the live sample rate."""

INSTRUCTED_SOURCES = "tactophone.instructed_sources"
"""Entry points called with settings and the name of an object to touch; each returns a
`tactophone.app.sources.InstructedSource`."""

DETECTORS = "tactophone.detectors"
"""Entry points called with ``sample_rate`` and ``channels``; each returns a
`tactophone.core.types.Detector`."""

PASSTHROUGHS = "tactophone.passthroughs"
"""Entry points called with `tactophone.signal.haptics.limits.Limits` or ``None``; each
returns a `tactophone.signal.haptics.passthrough.Passthrough`. Their names are rendering
profiles."""

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
