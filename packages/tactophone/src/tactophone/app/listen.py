"""The page that listens, served or as the files of a site."""

import importlib.util
import json
import shutil
from functools import partial
from pathlib import Path
from typing import Any

from tactophone.core.settings import DEFAULT_CEILING
from tactophone.faces.web.server import Page
from tactophone.signal import silences
from tactophone.signal.haptics.profiles import (
    ROUGH_STIMULUS,
    SMOOTH_STIMULUS,
    Stimulus,
)
from tactophone.signal.perception import contact, detector, evidence, no_touch
from tactophone.signal.perception.models import model_path

MODEL = "stylus"
"""The model for one microphone: a computer's or a phone's."""

NOTICES = "ThirdPartyNotices.txt"
"""What the runtime holds of others; the package `onnxruntime` has the list."""


def serve_listening(**place: Any) -> Page:
    """Serve the page that listens; ``place`` as in `Page`."""
    return Page(partial(_build, model_path(MODEL), constants()), **place)


def _build(model: Path, constants: str) -> Any:
    from tactophone.faces.web.listen import listen_page

    return listen_page(model, constants)


def write_listening_site(folder: Path) -> None:
    """Write the page and all that it loads into a folder, for any web server."""
    from tactophone.faces.web.listen import room_in, write_site

    write_site(folder, model_path(MODEL), constants())
    runtime = importlib.util.find_spec("onnxruntime")
    assert runtime is not None
    assert runtime.origin is not None
    notices = Path(runtime.origin).parent / NOTICES
    if notices.exists():  # distributions of their own may leave it out
        place = Path("static", "vendor", "onnxruntime-web", NOTICES)
        shutil.copy(notices, room_in(folder, place))


def constants() -> str:
    """Return the module with what the page takes from the telephone: the two stimuli
    of the paper and the default ceiling, which it renders, and when a touch is rough.
    """
    exported: dict[str, Any] = {
        "SMOOTH": _numbers(SMOOTH_STIMULUS),
        "ROUGH": _numbers(ROUGH_STIMULUS),
        "HIGHEST_CEILING": DEFAULT_CEILING,
        "LEAST": evidence.LEAST,
        "ROUGH_FROM": evidence.ROUGH_FROM,
        "MOST": evidence.MOST,
        "GREATEST_STEP": evidence.GREATEST_STEP,
        "CAUTION": evidence.CAUTION,
        "PAUSE": silences.PAUSE,
        "FADED_PAUSE": silences.FADED_PAUSE,
        "TOUCH_HOLD": silences.TOUCH_HOLD,
        "LIFT": silences.LIFT,
        "FADING": detector.FADING,
        "FADED_DB": detector.FADED_DB,
        "RELEASE_DB": contact.RELEASE_DB,
        "SCORE_LIMIT": no_touch.SCORE_LIMIT,
        "NOTICE_MEMORY": no_touch.NOTICE_MEMORY,
        "END_MEMORY": no_touch.END_MEMORY,
        "NOTICE_FROM": no_touch.NOTICE_FROM,
        "END_UNDER": no_touch.END_UNDER,
    }
    lines = ["// The telephone's own constants; its source says more of them."]
    for name, value in exported.items():
        lines.append(f"export const {name} = {json.dumps(value)};")
    return "\n".join(lines) + "\n"


def _numbers(stimulus: Stimulus) -> dict[str, float]:
    """Return a stimulus in Hz and dB of full drive."""
    return {"frequency": stimulus.frequency, "dbfs": stimulus.level_dbfs}
