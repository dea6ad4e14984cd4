"""The page of a guided command, such as `tactophone setup`: its steps, meters and
result, and the button of each step.

The page decides nothing: it shows what the command sends and passes on which button was
pressed. It is served to this machine alone, by its address and once more by the check
of each connection.
"""

import json
from functools import partial
from multiprocessing.connection import Connection

from aiohttp import WSMsgType, web

from tactophone.faces.web.views import (
    PAGE_VIEWERS,
    STATIC,
    Answers,
    admit,
    is_local,
    messages_of,
    page,
)

LONGEST_BUTTON = 16
"""Characters of a button's name."""


def guide_page(orders: Connection) -> web.Application:
    """Build the page of the guided command at the other end of a pipe; the first press
    of a button counts for all."""
    app = web.Application()
    command = Answers(orders, set())
    app.router.add_get("/", page(STATIC / "guide.html"))
    app.router.add_get("/guide", partial(_show, command))
    app.on_startup.append(command.follow)
    return app


async def _show(command: Answers, request: web.Request) -> web.StreamResponse:
    view = await admit(request, command.views, PAGE_VIEWERS)
    if view is None:
        return web.Response()
    if not is_local(request):
        await view.close(
            code=1008, message=b"open this page on the machine that runs the command"
        )
        return view
    command.views.add(view)
    try:
        await view.send_str(json.dumps(command.status))
        async for message in messages_of(view):
            if message.type is WSMsgType.TEXT and len(message.data) <= LONGEST_BUTTON:
                command.send(message.data)
    finally:
        command.views.discard(view)
    return view
