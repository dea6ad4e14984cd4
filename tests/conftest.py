"""What all tests share: where the real recordings are, if anywhere."""

import os
from pathlib import Path

import pytest


@pytest.fixture(scope="session")
def recordings() -> Path:
    """The folder of real recordings; a test that needs it is skipped, with a word, where there is none."""
    folder = Path(os.environ.get("TACTOPHONE_RECORDINGS", "../shared/recordings"))
    if not folder.is_dir():
        pytest.skip("no real recordings here: set TACTOPHONE_RECORDINGS to their folder")
    return folder
