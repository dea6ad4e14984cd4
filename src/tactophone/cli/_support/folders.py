"""Folders for a verb's results."""

import os
from pathlib import Path

from tactophone.errors import ConfigError


def make_folder(path: Path, option: str = "--out") -> None:
    """Make a folder for results, unless it exists; raises `ConfigError` if nothing can be written there."""
    try:
        path.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise ConfigError(f"{option} {path}: cannot be made ({error.strerror}); name a folder of your own") from error
    if not os.access(path, os.W_OK | os.X_OK):
        raise ConfigError(f"{option} {path}: nothing can be written there; name a folder of your own")
