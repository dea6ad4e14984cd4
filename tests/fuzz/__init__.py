"""Fuzzing of every parser of outside bytes: ``python -m tests.fuzz --seconds 60``."""

from .file_targets import TARGETS as FILE_TARGETS
from .link_targets import TARGETS as LINK_TARGETS
from .outside_targets import TARGETS as OUTSIDE_TARGETS
from .target import Target

TARGETS: dict[str, Target] = LINK_TARGETS | FILE_TARGETS | OUTSIDE_TARGETS
"""By the name of what is parsed."""
