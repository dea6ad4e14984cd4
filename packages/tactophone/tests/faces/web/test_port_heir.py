"""Another user's program takes the port of a run that has ended: a page that is still
open calls it, and obeys nothing that it says."""

import asyncio
import threading
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np
import pytest
from aiohttp import web
from selenium import webdriver

from tactophone.faces.web.feed import pack
from tactophone.faces.web.server import watch
from tests.browser import text, wait
from tests.faces.web.running import Run
from tests.faces.web.test_feel import PAD, calls, feel, inject

__all__ = ["inject"]

pytestmark = pytest.mark.realtime

COMMANDS = 200


class Heir:
    """A server at the port, which answers every call with full drive."""

    def __init__(self, port: int) -> None:
        self.called = 0
        self.heard = 0
        self._port = port
        self._ended = asyncio.Event()

    async def _drive(self, request: web.Request) -> web.WebSocketResponse:
        view = web.WebSocketResponse()
        await view.prepare(request)
        self.called += 1
        listening = asyncio.create_task(self._listen(view))
        full = {"alive": True, "armed": True, "ceiling": 1.0, "command": [1.0, 1.0, 60]}
        silence = {"vibration": np.zeros(0, np.float32)}
        try:
            for _ in range(COMMANDS):
                await view.send_bytes(pack(full | {"muted_because": ""}, silence))
                await asyncio.sleep(0.01)
        except ConnectionError:
            pass
        listening.cancel()
        return view

    async def _listen(self, view: web.WebSocketResponse) -> None:
        async for _ in view:
            self.heard += 1

    async def serve(self) -> None:
        app = web.Application()
        app.router.add_get("/{path:.*}", self._drive)
        runner = web.AppRunner(app, shutdown_timeout=0)
        await runner.setup()
        await web.TCPSite(runner, "127.0.0.1", self._port).start()
        await self._ended.wait()
        await runner.cleanup()

    def end(self) -> None:
        self._ended.set()


@contextmanager
def heir_of(port: int) -> Iterator[Heir]:
    loop = asyncio.new_event_loop()
    heir = Heir(port)
    thread = threading.Thread(target=loop.run_until_complete, args=(heir.serve(),))
    thread.start()
    try:
        yield heir
    finally:
        loop.call_soon_threadsafe(heir.end)
        thread.join()
        loop.close()


def test_who_takes_the_port_of_an_ended_run_moves_no_fingertip(
    run: Run, browser: webdriver.Chrome, inject
) -> None:
    inject(PAD)
    with watch(run.telemetry.name) as page:
        feel(browser, page)
        port = page.access.port
    wait(browser, lambda: text(browser, "life") != "live")
    calls(browser)
    with heir_of(port) as heir:
        # The feed of the page, and that of its fingertip.
        wait(browser, lambda: heir.called >= 2)
        wait(browser, lambda: "another program" in text(browser, "feel-way"))
        effects = [call for call in calls(browser) if call[1] != "reset"]
        assert effects == []
        assert text(browser, "life") != "live"
        assert heir.heard == 0
