"""All settings as frozen dataclasses, read from TOML and checked.

A TOML file overrides the defaults, and ``--set section.name=value`` overrides the file. Each setting carries its unit,
its range and the words that ``--help`` and ``tactophone settings`` show, so that they stand in one place.
"""

from tactophone.config.reading import Entry, change, entries, read, read_tables, replace
from tactophone.config.sections import Finger, Link, Settings

__all__ = ["Entry", "Finger", "Link", "Settings", "change", "entries", "read", "read_tables", "replace"]
