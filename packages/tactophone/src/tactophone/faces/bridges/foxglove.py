"""The Foxglove WebSocket protocol: a run live in Foxglove or Lichtblick, over our own
server.

The protocol (github.com/foxglove/ws-protocol, docs/spec.md) is JSON for advertising and
subscribing and a binary frame for each message. Its two names,
``foxglove.websocket.v1`` and ``foxglove.sdk.v1``, mean the same here; old viewers know
only the first, new ones only the second. A viewer can subscribe, and nothing else.

Why our own server: foxglove-sdk's (0.30.3) admits any path and any page's Origin, keeps
silent connections and any number of viewers, and refuses viewers of the first protocol
name. Our token, the check of Origin and the limits against strangers
(docs/reference/threat-model.md) would fall with ours.
"""

import asyncio
import base64
import json
import re
import secrets
import struct
import threading
from collections import deque
from pathlib import Path
from typing import TYPE_CHECKING, Any, Self

from tactophone.faces.web.connections import RUNNER, Acceptor, listen, messages_of
from tactophone.live.log.log_topics import PACKETS, Message, Topic, topics_of
from tactophone.live.log.reader import RunReader, words_for_missed
from tactophone.live.log.sound import SoundMessages

if TYPE_CHECKING:
    from aiohttp import web

FOXGLOVE_ADDRESS = "127.0.0.1:8765"
"""Where Foxglove looks by itself."""

PROTOCOLS = ("foxglove.sdk.v1", "foxglove.websocket.v1")
"""Names of the protocol, the newer first: they mean the same here."""

ORIGINS = ("https://app.foxglove.dev", "null", "file://")
"""Origins of Foxglove's page and of the desktop programs; others only from this
machine."""

FOXGLOVE_INTERVAL = 0.02
"""Seconds between two reads of the run."""

CLIENT_BACKLOG = 500
"""Messages kept for a slow viewer: several seconds; older ones are dropped."""

FOXGLOVE_VIEWERS = 8
"""Greatest number of viewers."""

MESSAGES_PER_SECOND = 100.0
"""Messages that a viewer may send in a second: it only says once what it subscribes
to."""

LAYOUT = Path(__file__).with_name("foxglove_layout.json")
"""A layout to import in Foxglove or Lichtblick."""

_FRAME = struct.Struct("<BIQ")
"""Head of a binary frame: its kind, the subscription, and the time in ns."""

_MESSAGE_DATA = 1
"""Kind of a binary frame that holds a message."""


class FoxgloveBridge:
    """Serves a run to viewers who know the path ``token``; a context manager.

    Call `read` every `FOXGLOVE_INTERVAL`.

    Raises `ConfigError` when the address cannot be used.
    """

    interval = FOXGLOVE_INTERVAL
    title = "the Foxglove bridge"

    def __init__(
        self, name: str, address: str = FOXGLOVE_ADDRESS, *, token: str = ""
    ) -> None:
        self.name = name
        self.token = token
        self._reader = RunReader(name)
        self._sound = SoundMessages(self._reader.names)
        shown = [
            topic
            for topic in topics_of(self._reader.names, sound=True)
            if topic is not PACKETS
        ]
        self._shown = {topic.name: number for number, topic in enumerate(shown, 1)}
        self._advertised = json.dumps(
            {
                "op": "advertise",
                "channels": [*map(_channel, range(1, len(shown) + 1), shown)],
            }
        )
        self._listening = listen(address, "--bridge foxglove", example=FOXGLOVE_ADDRESS)
        self._acceptor = Acceptor()
        self._viewers: set[_Viewer] = set()
        self._dropped = 0
        # A viewer that comes later needs the start of the run and its state too.
        self._latched: dict[str, Message] = {}
        self._loop = asyncio.new_event_loop()
        self._thread = threading.Thread(
            target=self._serve, name="foxglove", daemon=True
        )

    @property
    def port(self) -> int:
        return int(self._listening.getsockname()[1])

    def __enter__(self) -> Self:
        self._ready = threading.Event()
        self._thread.start()
        self._ready.wait(10)
        return self

    def __exit__(self, *_: object) -> None:
        self._loop.call_soon_threadsafe(self._loop.stop)
        self._thread.join(2)
        self._listening.close()

    def lost(self) -> str:
        """What was not read in time, and what slow viewers did not get."""
        dropped = f"{self._dropped} messages to slow viewers" if self._dropped else ""
        unread = words_for_missed(self._reader.missed)
        return " and ".join(filter(None, (unread, dropped)))

    def read(self) -> None:
        messages: list[Message] = []
        for message in self._reader.read():
            messages += self._sound.push(message.topic.name, message.data)
            if message.topic is not PACKETS:
                messages.append(message)
        if messages:
            self._loop.call_soon_threadsafe(self._offer, messages)

    def _offer(self, messages: list[Message]) -> None:
        for message in messages:
            if message.topic.name in ("/tactophone/run", "/tactophone/state"):
                self._latched[message.topic.name] = message
            for viewer in self._viewers:
                self._dropped += viewer.offer(message)

    def _serve(self) -> None:
        from aiohttp import web

        asyncio.set_event_loop(self._loop)
        app = web.Application(client_max_size=1 << 14)
        app.router.add_get("/{token}/", self._view)
        app.router.add_get("/{token}", self._view)
        runner = web.AppRunner(app, **RUNNER)
        self._loop.run_until_complete(runner.setup())
        accepting = self._loop.create_task(
            self._acceptor.serve(runner, self._listening)
        )
        self._ready.set()
        self._loop.run_forever()
        accepting.cancel()
        for viewer in list(self._viewers):
            self._loop.run_until_complete(viewer.socket.close())
        self._loop.run_until_complete(runner.cleanup())
        self._loop.close()

    async def _view(self, request: "web.Request") -> "web.StreamResponse":
        from aiohttp import web

        if refused := self._refusal(request):
            return web.Response(status=403, text=f"Refused: {refused}.\n")
        self._acceptor.admit(request.protocol)
        if len(self._viewers) >= FOXGLOVE_VIEWERS:
            return web.Response(
                status=503,
                text=f"{FOXGLOVE_VIEWERS} viewers are connected already: close one.\n",
            )
        view = web.WebSocketResponse(
            protocols=PROTOCOLS,
            max_msg_size=1 << 16,
            heartbeat=20,
            autoping=False,
            # Sound shrinks by 7 % for 1.3 % of a core and viewer.
            compress=False,
        )
        await view.prepare(request)
        if view.ws_protocol is None:
            await view.close(
                code=1002, message=f"wanted one of {', '.join(PROTOCOLS)}".encode()
            )
            return view
        viewer = _Viewer(view, self._shown, self._latched)
        info = {
            "op": "serverInfo",
            "name": f"tactophone {self.name}",
            "capabilities": [],
            "metadata": {},
        }
        info |= {
            "supportedEncodings": ["json", "protobuf"],
            "sessionId": secrets.token_hex(4),
        }
        try:
            await view.send_str(json.dumps(info))
            await view.send_str(self._advertised)
        except ConnectionError:  # it has left already
            return view
        self._viewers.add(viewer)
        sending = asyncio.ensure_future(viewer.send())
        try:
            async for message in messages_of(
                view, rate=MESSAGES_PER_SECOND, code=1008, reason="too many messages"
            ):
                if message.type is web.WSMsgType.TEXT:
                    viewer.obey(message.data)
        finally:
            self._viewers.discard(viewer)
            sending.cancel()
        return view

    def _refusal(self, request: "web.Request") -> str:
        if not secrets.compare_digest(
            request.match_info["token"].encode(), self.token.encode()
        ):
            return "the token is wrong"
        origin = request.headers.get("Origin")
        local = re.fullmatch(r"http://(127\.0\.0\.1|localhost):[0-9]+", origin or "")
        return (
            ""
            if origin is None or origin in ORIGINS or local
            else "Origin is another page"
        )


class _Viewer:
    """One viewer: what it subscribed to, and what waits for it."""

    def __init__(
        self,
        view: "web.WebSocketResponse",
        shown: dict[str, int],
        latched: dict[str, Message],
    ) -> None:
        self.socket = view
        self._shown = shown
        self._latched = latched
        self._subscribed: dict[
            int, int
        ] = {}  # channel -> the viewer's number of the subscription
        self._waiting: deque[Message] = deque(maxlen=CLIENT_BACKLOG)
        self._wake = asyncio.Event()

    def offer(self, message: Message) -> bool:
        """Queue a message that it subscribed to; returns whether an older one was
        dropped for it."""
        if self._shown[message.topic.name] not in self._subscribed:
            return False
        full = len(self._waiting) == CLIENT_BACKLOG
        self._waiting.append(message)
        self._wake.set()
        return full

    def obey(self, text: str) -> None:
        """Subscribe and unsubscribe; everything else is ignored."""
        try:
            request = json.loads(text)
            if request["op"] == "subscribe":
                for entry in request["subscriptions"]:
                    self._subscribe(int(entry["channelId"]), int(entry["id"]))
            elif request["op"] == "unsubscribe":
                ended = {int(number) for number in request["subscriptionIds"]}
                self._subscribed = {
                    channel: number
                    for channel, number in self._subscribed.items()
                    if number not in ended
                }
        except (
            ValueError,
            KeyError,
            TypeError,
            AttributeError,
            OverflowError,
            RecursionError,
        ):
            return

    async def send(self) -> None:
        while not self.socket.closed:
            await self._wake.wait()
            self._wake.clear()
            while self._waiting:
                message = self._waiting.popleft()
                number = self._subscribed.get(self._shown[message.topic.name])
                if number is not None:
                    head = _FRAME.pack(_MESSAGE_DATA, number, round(message.time * 1e9))
                    await self.socket.send_bytes(head + message.data)

    def _subscribe(self, channel: int, number: int) -> None:
        if not 0 < channel <= len(self._shown) or not 0 <= number < 1 << 32:
            return
        self._subscribed[channel] = number
        for latched in self._latched.values():
            if self._shown[latched.topic.name] == channel:
                self.offer(latched)


def _channel(number: int, topic: Topic) -> dict[str, Any]:
    schema = topic.schema
    # Binary schemas travel as base64.
    text = (
        base64.b64encode(schema.data).decode()
        if schema.encoding == "protobuf"
        else schema.data.decode()
    )
    return {
        "id": number,
        "topic": topic.name,
        "encoding": schema.message_encoding,
        "schemaName": schema.name,
        "schemaEncoding": schema.encoding,
        "schema": text,
    }
