"""The page of a guided command, such as `tactophone setup`: its steps, meters and result, and the button of each step.

The page decides nothing: it shows what the command sends and passes on which button was pressed. It is served to this
machine alone, by its address and once more by the check of each connection.
"""

import json
from multiprocessing.connection import Connection
from typing import Any

from aiohttp import WSMsgType, web

from tactophone.pages.views import STATIC, VIEWERS, Answers, admit, is_local, messages_of, page

LONGEST_BUTTON = 16
"""Characters of a button's name."""


class Guide(Answers):
    """Shows a guided command to every page that is open; the first press of a button counts for all."""

    def __init__(self, orders: Connection) -> None:
        super().__init__(orders, set())
        self.status: dict[str, Any] = {}

    def keep(self, answer: dict[str, Any]) -> None:
        """Keep everything, the newest of each kind."""
        self.status |= answer

    async def connect(self, request: web.Request) -> web.StreamResponse:
        """Show the command to a page until it leaves."""
        view = await admit(request, self._views, VIEWERS)
        if view is None:
            return web.Response()
        if not is_local(request):
            await view.close(code=1008, message=b"open this page on the machine that runs the command")
            return view
        self._views.add(view)
        try:
            await view.send_str(json.dumps(self.status))
            async for message in messages_of(view):
                if message.type is WSMsgType.TEXT and len(message.data) <= LONGEST_BUTTON:
                    self.send(message.data)
        finally:
            self._views.discard(view)
        return view


def guide_page(orders: Connection) -> web.Application:
    """Build the page of the guided command at the other end of a pipe."""
    app, guide = web.Application(), Guide(orders)
    app.router.add_get("/", page(STATIC / "guide.html"))
    app.router.add_get("/guide", guide.connect)
    app.on_startup.append(guide.follow)
    return app
