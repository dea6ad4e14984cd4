"""The engine that runs model files."""

from tactophone.perception.inference.engine import Engine

__all__ = ["Engine"]
