"""Touch for NVIDIA Isaac Teleop, both ways."""

from isaacteleop_tactophone.source import TouchSource

__all__ = ["TouchSource"]
