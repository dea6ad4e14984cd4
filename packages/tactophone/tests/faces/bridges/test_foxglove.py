import asyncio
import base64
import json
import socket
import struct
import subprocess
import time
from collections.abc import Iterator
from contextlib import ExitStack, suppress
from typing import Any

import pytest

from tactophone.core.errors import ConfigError
from tactophone.core.settings import Settings
from tactophone.faces.bridges.foxglove import LAYOUT, PROTOCOLS, FoxgloveBridge
from tactophone.faces.web.connections import CONNECTION_TIMEOUT
from tactophone.live.log.log_topics import TOPICS
from tactophone.live.runtime.recorder import SessionRecorder
from tactophone.live.telemetry.layout import FingerState, RunState
from tactophone.live.telemetry.writer import Telemetry
from tests.faces.bridges.test_osc import STEP
from tests.node import NODE, needs_node

aiohttp = pytest.importorskip("aiohttp")


@pytest.fixture
def telemetry(request: pytest.FixtureRequest) -> Iterator[Telemetry]:
    with Telemetry(f"test-foxglove-{abs(hash(request.node.name))}") as telemetry:
        SessionRecorder(telemetry, Settings(), role="operator")
        telemetry.update(
            RunState(
                role="operator", fingers=(FingerState(armed=True, muted_because=""),)
            ),
            now=time.monotonic(),
        )
        yield telemetry


@pytest.fixture
def bridge(telemetry: Telemetry) -> Iterator[FoxgloveBridge]:
    with FoxgloveBridge(telemetry.name, "127.0.0.1:0", token="secret") as bridge:
        yield bridge


async def watch(
    bridge: FoxgloveBridge, telemetry: Telemetry, protocol: str, *sent: str
) -> tuple[list[dict[str, Any]], list[tuple[int, int, bytes]]]:
    """Connect, send what is given, subscribe to predictions and state; return what
    came."""
    texts: list[dict[str, Any]] = []
    frames: list[tuple[int, int, bytes]] = []
    url = f"ws://127.0.0.1:{bridge.port}/secret/"
    # A browser offers compression too; what is sent hardly shrinks.
    async with (
        aiohttp.ClientSession() as session,
        session.ws_connect(url, protocols=[protocol], compress=15) as view,
    ):
        assert (view.protocol, view.compress) == (protocol, 0)
        texts += [json.loads(await view.receive_str(timeout=5)) for _ in range(2)]
        channels = {channel["topic"]: channel["id"] for channel in texts[1]["channels"]}
        for text in sent:
            await view.send_str(text)
        wanted = [
            {"id": 70, "channelId": channels["/tactophone/prediction"]},
            {"id": 71, "channelId": channels["/tactophone/state"]},
        ]
        await view.send_str(json.dumps({"op": "subscribe", "subscriptions": wanted}))
        await asyncio.sleep(0.2)
        telemetry.publish(STEP, now=time.monotonic())
        bridge.read()
        for _ in range(2):
            data = await view.receive_bytes(timeout=5)
            kind, number, stamp = struct.unpack_from("<BIQ", data)
            assert kind == 1
            frames.append((number, stamp, data[13:]))
    return texts, frames


@pytest.mark.parametrize("protocol", PROTOCOLS)
def test_a_client_of_either_protocol_sees_predictions_and_state(
    bridge: FoxgloveBridge, telemetry: Telemetry, protocol: str
) -> None:
    bridge.read()
    texts, frames = asyncio.run(watch(bridge, telemetry, protocol))
    info, advertised = texts
    assert info["op"] == "serverInfo"
    assert info["capabilities"] == []
    by_topic = {channel["topic"]: channel for channel in advertised["channels"]}
    assert set(by_topic) == {topic.name for topic in TOPICS} - {"/tactophone/packets"}
    sound = by_topic["/tactophone/sound/contact"]
    assert (sound["schemaName"], sound["encoding"]) == (
        "foxglove.CompressedAudio",
        "protobuf",
    )
    assert b"CompressedAudio" in base64.b64decode(sound["schema"])
    found = {number: json.loads(data) for number, _, data in frames}
    # The topic is latched: it was published before the client came.
    assert found[71]["armed"] is True
    assert found[70]["amplitude"] == 0.5
    assert all(abs(stamp / 1e9 - time.time()) < 60 for _, stamp, _ in frames)


@needs_node
@pytest.mark.realtime
def test_the_published_client_sees_predictions_and_state(
    bridge: FoxgloveBridge, telemetry: Telemetry
) -> None:
    """npm's @foxglove/ws-protocol, the client of Foxglove's own programs."""
    bridge.read()
    topics = ("/tactophone/prediction", "/tactophone/state")
    url = f"ws://127.0.0.1:{bridge.port}/secret/"
    client = subprocess.Popen(
        ["node", NODE / "foxglove_client.cjs", url, *topics],
        stdout=subprocess.PIPE,
        text=True,
    )
    until = time.monotonic() + 20
    while client.poll() is None and time.monotonic() < until:
        telemetry.publish(STEP, now=time.monotonic())
        bridge.read()
        time.sleep(0.05)
    client.kill()
    lines = [json.loads(line) for line in client.communicate()[0].splitlines()]
    assert [line["kind"] for line in lines] == [
        "serverInfo",
        "advertise",
        "message",
        "message",
    ]
    assert lines[0]["capabilities"] == []
    found = {line["topic"]: line["data"] for line in lines[2:]}
    assert found["/tactophone/state"]["armed"] is True
    assert found["/tactophone/prediction"]["amplitude"] == 0.5


def test_nothing_that_a_viewer_sends_reaches_the_run(
    bridge: FoxgloveBridge, telemetry: Telemetry
) -> None:
    hostile = [
        "",
        "[]",
        "{}",
        '{"op": "subscribe"}',
        '{"op": "subscribe", "subscriptions": [{"id": -1, "channelId": 1}]}',
        '{"op": "advertise", "channels": [{"id": 1, "topic": "/tactophone/arm"}]}',
        '{"op": "unsubscribe"}',
        '{"op": "setParameters", "parameters": [{"name": "ceiling", "value": 1}]}',
        "x" * 10_000,
    ]
    bridge.read()
    _, frames = asyncio.run(watch(bridge, telemetry, PROTOCOLS[0], *hostile))
    assert {number for number, _, _ in frames} == {70, 71}
    assert telemetry.requests() == []


@pytest.mark.parametrize(
    ("path", "origin", "protocol"),
    [
        ("wrong", None, PROTOCOLS[0]),
        ("secret", "https://evil.example", PROTOCOLS[0]),
        ("secret", None, "other.v1"),
    ],
)
def test_strangers_are_refused(
    bridge: FoxgloveBridge, path: str, origin: str | None, protocol: str
) -> None:
    async def connect() -> None:
        headers = {"Origin": origin} if origin else {}
        url = f"ws://127.0.0.1:{bridge.port}/{path}/"
        async with (
            aiohttp.ClientSession() as session,
            session.ws_connect(url, protocols=[protocol], headers=headers) as view,
        ):
            message = await view.receive(timeout=5)
            assert message.type in (aiohttp.WSMsgType.CLOSE, aiohttp.WSMsgType.CLOSED)
            raise ConnectionError("closed at once")

    with pytest.raises((aiohttp.WSServerHandshakeError, ConnectionError)):
        asyncio.run(connect())


def test_the_layout_shows_topics_that_exist() -> None:
    layout = json.loads(LAYOUT.read_text())
    names = {topic.name for topic in TOPICS}
    for panel in layout["configById"].values():
        for path in panel.get("paths", []):
            assert path["value"].partition(".")[0] in names


def test_an_address_in_use_is_one_line(
    bridge: FoxgloveBridge, telemetry: Telemetry
) -> None:
    with pytest.raises(ConfigError, match="choose another address"):
        FoxgloveBridge(telemetry.name, f"127.0.0.1:{bridge.port}")


@pytest.mark.slow
def test_half_a_header_is_cut_off_and_keeps_no_viewer_away(
    bridge: FoxgloveBridge, telemetry: Telemetry
) -> None:
    with ExitStack() as stack:
        for _ in range(300):
            half = stack.enter_context(
                socket.create_connection(("127.0.0.1", bridge.port))
            )
            half.sendall(b"GET / HTTP/1.1\r\nHost: x")
        asyncio.run(watch(bridge, telemetry, PROTOCOLS[0]))
        half.settimeout(2 * CONNECTION_TIMEOUT)
        with suppress(ConnectionResetError):
            assert half.recv(1) == b""


def test_malformed_requests_leave_the_viewer_connected(
    bridge: FoxgloveBridge, telemetry: Telemetry
) -> None:
    wild = [
        '{"op":"subscribe","subscriptions":[{"id":1,"channelId":1e999}]}',
        "[" * 60_000,
        "[]",
        '{"op":"subscribe","subscriptions":["ab"]}',
        '{"op":"unsubscribe","subscriptionIds":[1e999]}',
    ]
    bridge.read()
    assert len(asyncio.run(watch(bridge, telemetry, PROTOCOLS[0], *wild))[1]) == 2


@pytest.mark.parametrize(
    "origin", ["http://evil.example", "http://localhost:1.evil.example"]
)
def test_other_origins_are_refused(bridge: FoxgloveBridge, origin: str) -> None:
    async def attempt() -> int:
        async with aiohttp.ClientSession() as session:
            try:
                await session.ws_connect(
                    f"http://127.0.0.1:{bridge.port}/secret/", origin=origin
                )
            except aiohttp.WSServerHandshakeError as error:
                return error.status
        return 101

    assert asyncio.run(attempt()) == 403
