"""The page that listens, served or as the files of a site."""

import importlib.util
import json
import shutil
from functools import partial
from pathlib import Path
from typing import Any

from tactophone.core.settings import DEFAULT_CEILING
from tactophone.faces.web.server import Page
from tactophone.signal.haptics.profiles import (
    ROUGH_STIMULUS,
    SMOOTH_STIMULUS,
    Stimulus,
)
from tactophone.signal.perception.models import model_path

MODEL = "stylus"
"""The model for one microphone: a computer's or a phone's."""

NOTICES = "ThirdPartyNotices.txt"
"""What the runtime holds of others; the package `onnxruntime` has the list."""


def serve_listening(**place: Any) -> Page:
    """Serve the page that listens; ``place`` as in `Page`."""
    return Page(partial(_build, model_path(MODEL), stimuli()), **place)


def _build(model: Path, stimuli: str) -> Any:
    from tactophone.faces.web.listen import listen_page

    return listen_page(model, stimuli)


def write_listening_site(folder: Path) -> None:
    """Write the page and all that it loads into a folder, for any web server."""
    from tactophone.faces.web.listen import write_site

    write_site(folder, model_path(MODEL), stimuli())
    runtime = importlib.util.find_spec("onnxruntime")
    assert runtime is not None
    assert runtime.origin is not None
    notices = Path(runtime.origin).parent / NOTICES
    if notices.exists():  # distributions of their own may leave it out
        shutil.copy(notices, folder / "static" / "vendor" / "onnxruntime-web")


def stimuli() -> str:
    """Return the module with the vibration that the page renders: the telephone's own
    two stimuli of the paper, and its default ceiling."""
    return (
        "// The paper's two stimuli, in Hz and dB of full drive; the ceiling, 0 to 1.\n"
        f"export const SMOOTH = {_object(SMOOTH_STIMULUS)};\n"
        f"export const ROUGH = {_object(ROUGH_STIMULUS)};\n"
        f"export const HIGHEST_CEILING = {DEFAULT_CEILING};\n"
    )


def _object(stimulus: Stimulus) -> str:
    return json.dumps({"frequency": stimulus.frequency, "dbfs": stimulus.level_dbfs})
