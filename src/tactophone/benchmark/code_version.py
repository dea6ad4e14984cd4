"""A hash of the code that predictions follow from, for the keys of cached folds: nobody has to raise a version."""

import functools
import hashlib
from importlib.resources import files
from pathlib import Path

import tactophone

PARTS = (
    "perception", "training", "haptics/passthrough.py", "link/codec.py", "types.py", "dataset/channels.py",
    "benchmark/methods.py", "benchmark/regression_features.py", "benchmark/height_regression.py",
)  # fmt: skip
"""Folders and files of the package that train detectors or run them."""


@functools.cache
def code_version() -> str:
    """Return the hash; comments and docstrings count too, as the files' bytes do."""
    root = Path(str(files(tactophone)))
    total = hashlib.sha256()
    for part in PARTS:
        place = root / part
        for path in sorted(place.rglob("*.py")) if place.is_dir() else [place]:
            total.update(path.relative_to(root).as_posix().encode() + b"\0" + path.read_bytes())
    return total.hexdigest()[:16]
