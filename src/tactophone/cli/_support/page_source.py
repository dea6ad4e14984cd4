"""``--source browser`` and ``--source microphone``: one air microphone, of a page or of this machine."""

from dataclasses import dataclass
from functools import partial
from multiprocessing import Pipe
from multiprocessing.connection import Connection
from typing import TYPE_CHECKING

from tactophone.capture import browser_source
from tactophone.errors import ConfigError
from tactophone.settings import Settings, change
from tactophone.types import DEFAULT_TIP, Source

if TYPE_CHECKING:
    from tactophone.runtime import OpenSource

MODEL = "stylus"
"""The shipped model for one air microphone, and the tip it is for; `paper-mono` was trained on a contact microphone."""


@dataclass(frozen=True, slots=True)
class PageSource:
    """What opens the source in the robot's process, and where a page's sound goes; ``None`` for other sources."""

    open: "OpenSource"
    microphone: Connection | None


def source_of(settings: Settings, *, page: bool = True) -> PageSource:
    """Return how the source of the settings is opened.

    Raises `ConfigError` if it is the microphone of a page, and there is none.
    """
    from tactophone.cli._support.sources import open_source  # needs the extra `link`

    if settings.capture.source != "browser":
        return PageSource(open_source, None)
    if not page:
        raise ConfigError("--source browser takes the microphone of a page: add --dashboard, or --lan for a phone")
    inbox, microphone = Pipe(duplex=False)
    return PageSource(partial(_open_browser, inbox), microphone)


def for_one_microphone(settings: Settings) -> Settings:
    """Choose the model for one air microphone, where that is the source and no model is named.

    What touches is anything then, so the tip is the model's, unless another than the default is named.
    """
    if settings.capture.source not in ("browser", "microphone") or settings.detector.model:
        return settings
    tip = [f"capture.tip={MODEL}"] if settings.capture.tip == DEFAULT_TIP else []
    return change(settings, [f"detector.model={MODEL}", *tip])


def _open_browser(sound: Connection, _: Settings) -> Source:
    return browser_source(sound)
