"""A page as the operator's actuator, or as the robot's microphone.

A page that renders the vibration fades to silence by itself 150 ms after its last
command (`static/fingertip.js`), and renders none that is older than 300 ms
(`static/age.js`). So this sends a command only when the run has made a new one, with
the time, and nothing stands in for a run that stalls or ends.

A page that listens sends messages with the position of their first sample since the
microphone started, uint32, and then samples of 48 kHz, float32, both little-endian.
They are passed on to the robot's side as they are (the detector zeroes and counts
invalid ones), and nothing else that the page sends goes anywhere.
"""

import asyncio
import json
import select
import time
from contextlib import suppress
from dataclasses import dataclass
from multiprocessing.connection import Connection
from typing import Any

import numpy as np
from aiohttp import WSMsgType, web

from tactophone.core.types import LIVE_SAMPLE_RATE
from tactophone.faces.web.connections import FloodGate
from tactophone.faces.web.feed import WatchedRun, pack
from tactophone.faces.web.views import TAKEN, admit, end_flood, finger_of, messages_of
from tactophone.live.telemetry.watcher import Snapshot

DEVICE_PERIOD = 0.005
"""Seconds between two looks for a new command: half the interval of predictions."""

FINGERTIP_CREDIT = 6
"""Unacknowledged messages to a page, 30 ms of them; a stalled page gets none until it
answers."""

LONGEST_VIBRATION = 7_200
"""Samples of vibration in a message at most: 0.15 s, beyond which a page drops them as
stale. So a message fits what a connection takes without waiting."""

LONGEST_QUESTION = 64
"""Characters of a question for the time."""

FINGERTIPS = 16
"""Greatest number of pages that render the vibration at once."""


def command_of(snapshot: Snapshot, last: Snapshot | None) -> dict[str, Any]:
    """Return what a page renders: ``command`` is ``None`` unless the run has made a new
    one since ``last``.

    The amplitude is that after every limit and the output gate, 0 to 1 of full drive.
    """
    entries: dict[str, Any] = {
        "alive": snapshot.alive,
        "armed": snapshot.finger.armed,
        "muted_because": snapshot.finger.muted_because,
        "ceiling": snapshot.finger.ceiling,
        "command": None,
    }
    # What is rendered is new, or the run hangs within its buzz.
    rendered = last is not None and snapshot.vibration_end != last.vibration_end
    if snapshot.finger.buzzing and snapshot.alive and rendered:
        strongest = snapshot.finger.ceiling * snapshot.finger.output_level
        # A motor buzzes as for certain rough; it has no frequency to choose.
        entries["command"] = [strongest * snapshot.finger.armed, 1.0, 0.0]
    elif (
        len(snapshot.steps)
        and snapshot.alive
        and (last is None or snapshot.step_end != last.step_end)
    ):
        newest = snapshot.steps[-1]
        amplitude = float(newest["amplitude"]) * snapshot.finger.armed
        entries["command"] = [
            amplitude,
            float(newest["roughness"]),
            float(newest["frequency"]),
        ]
    return entries


def answer_time(text: str) -> str:
    """Return the answer to a page that asks for the time, of which it sends its own;
    to anything else an empty one.

    >>> answer_time('{"action": "time", "time": "soon"}')
    '{}'
    """
    try:
        asked = json.loads(text)["time"] if len(text) <= LONGEST_QUESTION else None
    except (ValueError, TypeError, KeyError, RecursionError):
        asked = None
    if not isinstance(asked, int | float):
        return "{}"
    return json.dumps({"time": asked, "now": time.monotonic()})


@dataclass(eq=False, slots=True)
class _FingertipPage:
    """A page that renders the vibration, and how many messages it may still get before
    it answers."""

    view: web.WebSocketResponse
    transport: asyncio.Transport | None
    credit: int = FINGERTIP_CREDIT

    @property
    def takes(self) -> bool:
        """Whether a message can be sent without waiting: the page has answered, and the
        system has taken all that was sent. A page that answers and reads nothing would
        otherwise be waited for, and the other pages with it."""
        stalls = self.transport is None or self.transport.get_write_buffer_size() > 0
        return self.credit > 0 and not stalls


class Fingertips:
    """All pages that render a run's vibration; for each finger one task reads the run
    while there are pages of it."""

    def __init__(self, run: WatchedRun) -> None:
        self._run = run
        self._pages: set[_FingertipPage] = set()
        self._fingers: dict[int, _FingerPages] = {}

    async def connect(self, request: web.Request) -> web.StreamResponse:
        """Serve one page, of one finger, until it leaves."""
        view = await admit(request, self._pages, FINGERTIPS)
        if view is None:
            return web.Response()
        page = _FingertipPage(view, request.transport)
        self._pages.add(page)
        finger = finger_of(request)
        others = self._fingers.setdefault(finger, _FingerPages(self._run, finger))
        others.add(page)
        try:
            async for message in messages_of(view):
                if message.type is WSMsgType.TEXT and message.data == "ok":
                    page.credit = min(page.credit + 1, FINGERTIP_CREDIT)
                # Nothing waits for a page that asks and does not read.
                elif (
                    message.type is WSMsgType.TEXT
                    and page.transport is not None
                    and not page.transport.get_write_buffer_size()
                ):
                    await view.send_str(answer_time(message.data))
        finally:
            others.pages.discard(page)
            self._pages.discard(page)
        return view


class _FingerPages:
    """The pages that render one finger."""

    def __init__(self, run: WatchedRun, finger: int) -> None:
        self.pages: set[_FingertipPage] = set()
        self._run = run
        self._finger = finger
        self._sending: asyncio.Task[None] | None = None
        self._last: Snapshot | None = None

    def add(self, page: _FingertipPage) -> None:
        self.pages.add(page)
        if self._sending is None or self._sending.done():
            self._sending = asyncio.create_task(self._send())

    async def _send(self) -> None:
        self._last = None
        while self.pages:
            begun = time.monotonic()
            if message := self._message():
                for page in [page for page in self.pages if page.takes]:
                    page.credit -= 1
                    with suppress(ConnectionError):
                        await page.view.send_bytes(message)
            await asyncio.sleep(max(0.0, DEVICE_PERIOD - (time.monotonic() - begun)))

    def _message(self) -> bytes:
        """Return the message with what is new; empty when nothing is."""
        snapshot = self._run.snapshot(self._last, finger=self._finger)
        if snapshot is None:
            return b""
        restarted = self._last is not None and snapshot.restarts != self._last.restarts
        # A page plays only what follows its first message; older vibration is out of
        # date.
        vibration = (
            np.zeros(0, np.float32)
            if self._last is None or restarted or not snapshot.alive
            else snapshot.vibration[-LONGEST_VIBRATION:]
        )
        entries = command_of(snapshot, None if restarted else self._last)
        state_changed = (
            self._last is None
            or self._last.state != snapshot.state
            or self._last.alive != snapshot.alive
        )
        self._last = snapshot
        if entries["command"] is None and not len(vibration) and not state_changed:
            return b""
        return pack({**entries, "made": time.monotonic()}, {"vibration": vibration})


LONGEST_MESSAGE = 960
"""Samples: 20 ms, which fits into one write to a pipe."""

SOUND_RATE = 1.5 * LIVE_SAMPLE_RATE
"""Samples a second, with a margin over real time for what a slow network held back."""


def is_sound(data: bytes) -> bool:
    """Whether this is a position and 1 to `LONGEST_MESSAGE` whole samples."""
    return len(data) % 4 == 0 and 8 <= len(data) <= 4 + 4 * LONGEST_MESSAGE


class PageMicrophone:
    """The one page whose microphone is the source."""

    def __init__(self, sound: Connection) -> None:
        self._sound = sound
        self._view: web.WebSocketResponse | None = None

    async def connect(self, request: web.Request) -> web.StreamResponse:
        """Take sound from a page until it leaves; a second page is sent away."""
        view = await admit(request, (), 1)
        if view is None:
            return web.Response()
        if self._view is not None and not self._view.closed:
            await view.close(
                code=TAKEN,
                message=b"another page is the microphone already: stop it there first",
            )
            return view
        self._view = view
        gate = FloodGate(SOUND_RATE)
        async for message in messages_of(view):
            data = message.data
            if message.type is not WSMsgType.BINARY or not is_sound(data):
                await view.close(
                    code=1003, message=b"not a message of sound: reload the page"
                )
            elif gate.overflows(len(data) // 4 - 1):
                await end_flood(view)
            # Unless the pipe to the robot's side is full: a page must never make the
            # server wait.
            elif select.select([], [self._sound], [], 0)[1]:
                self._sound.send_bytes(data)
        return view
