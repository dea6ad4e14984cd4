"""The version of this package; `pyproject.toml` reads it from here. Both packages have
the same."""

__version__ = "0.1.0"
