"""The page's button *Record*: passed on to whoever keeps logs of the run, and what they answer, to every page.

The page's process writes no file: the command that started the run does (`cli/_support/page_recorder.py`).
"""

import asyncio
import json
from contextlib import suppress
from multiprocessing.connection import Connection
from typing import Any

from aiohttp import web


class Recorder:
    """One end of a pipe: true begins a log, false ends it; answers are shown by all pages.

    Attributes
    ----------
    status
        For a page that is opened now: ``recording`` is the file, empty while there is none.
    """

    def __init__(self, orders: Connection, views: set[web.WebSocketResponse]) -> None:
        self._orders, self._views = orders, views
        self._sending: set[asyncio.Task[None]] = set()
        self.status: dict[str, Any] = {"recording": ""}

    def ask(self, begin: bool) -> None:
        """Begin or end a log; the answer comes later."""
        with suppress(OSError):  # whoever kept the logs has ended, and soon ends this process too
            self._orders.send(begin)

    async def follow(self, app: web.Application) -> None:
        """Take answers as they come, once the server runs."""
        asyncio.get_running_loop().add_reader(self._orders.fileno(), self._take)

    def _take(self) -> None:
        try:
            answer = self._orders.recv()
        except (EOFError, OSError):
            asyncio.get_running_loop().remove_reader(self._orders.fileno())
            return
        if "recording" in answer:
            self.status = {"recording": answer["recording"]}
        for view in self._views:
            task = asyncio.ensure_future(_send(view, answer))
            self._sending.add(task)
            task.add_done_callback(self._sending.discard)


async def _send(view: web.WebSocketResponse, answer: dict[str, Any]) -> None:
    with suppress(ConnectionError):
        await view.send_str(json.dumps(answer))
