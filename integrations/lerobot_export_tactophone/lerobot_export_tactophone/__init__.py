"""Writes what a recorded run felt beside the frames of a robot's data set.

The package adds the verb ``tactophone export-lerobot``; `export.export` does the same
from Python.
"""

from tactophone.cli.verbs import Verb

VERBS = (
    Verb(
        "export-lerobot",
        "lerobot_export_tactophone.command",
        "sound",
        "write a recorded run beside a robot's own data: LeRobotDataset v3.0",
        ("link", "record"),
        special=True,
    ),
)
