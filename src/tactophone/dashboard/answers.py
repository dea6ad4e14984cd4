"""A pipe to the command that serves the page: what pages ask goes in, and its answers go to every page."""

import asyncio
import json
from contextlib import suppress
from multiprocessing.connection import Connection
from typing import Any

from aiohttp import web


class Answers:
    """The page's end of the pipe; the caller adds and removes the ``views``, the pages that are open now."""

    def __init__(self, orders: Connection, views: set[web.WebSocketResponse]) -> None:
        self._orders, self._views = orders, views
        self._sending: set[asyncio.Task[None]] = set()

    def send(self, order: Any) -> None:
        """Pass on what a page asks."""
        with suppress(OSError):  # the command has ended, and soon ends this process too
            self._orders.send(order)

    def keep(self, answer: dict[str, Any]) -> None:
        """Keep of an answer what a page that is opened later has to show."""

    async def follow(self, app: web.Application) -> None:
        """Take answers as they come, once the server runs."""
        asyncio.get_running_loop().add_reader(self._orders.fileno(), self._take)

    def _take(self) -> None:
        try:
            answer = self._orders.recv()
        except (EOFError, OSError):
            asyncio.get_running_loop().remove_reader(self._orders.fileno())
            return
        self.keep(answer)
        for view in self._views:
            task = asyncio.ensure_future(_send(view, answer))
            self._sending.add(task)
            task.add_done_callback(self._sending.discard)


async def _send(view: web.WebSocketResponse, answer: dict[str, Any]) -> None:
    with suppress(ConnectionError):
        await view.send_str(json.dumps(answer))
