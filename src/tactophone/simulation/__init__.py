"""Stand-ins for hardware, network and people that keep the real contracts.

``physics`` renders the finger's sound, ``content`` holds objects, movements and data sets, ``network`` impairs packets,
``participants`` simulates people. Names are loaded on first use, because numba and scipy take seconds to import.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from tactophone.simulation.exports import *  # noqa: F403


def __getattr__(name: str) -> Any:
    if name.startswith("__"):
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    return getattr(import_module("tactophone.simulation.exports"), name)
