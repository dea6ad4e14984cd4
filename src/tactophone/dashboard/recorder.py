"""The page's button *Record*: passed on to whoever keeps logs of the run, and what they answer, to every page.

The page's process writes no file: the command that started the run does (`cli/_support/page_recorder.py`).
"""

from multiprocessing.connection import Connection
from typing import Any

from aiohttp import web

from tactophone.dashboard.answers import Answers


class Recorder(Answers):
    """One end of a pipe: true begins a log, false ends it; answers are shown by all pages.

    Attributes
    ----------
    status
        For a page that is opened now: ``recording`` is the file, empty while there is none.
    """

    def __init__(self, orders: Connection, views: set[web.WebSocketResponse]) -> None:
        super().__init__(orders, views)
        self.status: dict[str, Any] = {"recording": ""}

    def ask(self, begin: bool) -> None:
        """Begin or end a log; the answer comes later."""
        self.send(begin)

    def keep(self, answer: dict[str, Any]) -> None:
        """Keep which file is recorded."""
        if "recording" in answer:
            self.status = {"recording": answer["recording"]}
