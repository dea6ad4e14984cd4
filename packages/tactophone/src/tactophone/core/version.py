"""The version of this package; `pyproject.toml` reads it from here. The laboratory has
the same."""

__version__ = "0.1.0"
