"""The microphone of a page: its sound goes to the robot's side, and nothing else that the page sends goes anywhere.

A message holds the position of its first sample since the microphone started, uint32, and then samples of 48 kHz,
float32, both little-endian. They are passed on as they are: the detector zeroes and counts invalid ones.
"""

import select
from multiprocessing.connection import Connection

from aiohttp import WSMsgType, web

from tactophone.dashboard.admission import TAKEN, FloodGate, admit, end_flood
from tactophone.types import LIVE_SAMPLE_RATE

LONGEST_MESSAGE = 960
"""Samples: 20 ms, which fits into one write to a pipe."""

FLOOD_RATE = 1.5 * LIVE_SAMPLE_RATE
"""Samples a second, with a margin over real time for what a slow network held back."""


class PageMicrophone:
    """The one page whose microphone is the source."""

    def __init__(self, sound: Connection) -> None:
        self._sound = sound
        self._view: web.WebSocketResponse | None = None
        self.dropped = 0

    async def connect(self, request: web.Request) -> web.StreamResponse:
        """Take sound from a page until it leaves; a second page is sent away."""
        view = await admit(request, (), 1)
        if view is None:
            return web.Response()
        if self._view is not None and not self._view.closed:
            await view.close(code=TAKEN, message=b"another page is the microphone already: stop it there first")
            return view
        self._view = view
        gate = FloodGate(FLOOD_RATE)
        async for message in view:
            if message.type is not WSMsgType.BINARY or not _is_sound(message.data):
                await view.close(code=1003, message=b"not a message of sound: reload the page")
            elif gate.overflows(len(message.data) // 4 - 1):
                await end_flood(view)
            else:
                self._pass_on(message.data)
        return view

    def _pass_on(self, message: bytes) -> None:
        """Write to the robot's side unless its pipe is full: a page must never make the server wait."""
        if select.select([], [self._sound], [], 0)[1]:
            self._sound.send_bytes(message)
        else:
            self.dropped += 1


def _is_sound(message: bytes) -> bool:
    return len(message) % 4 == 0 and 8 <= len(message) <= 4 + 4 * LONGEST_MESSAGE
