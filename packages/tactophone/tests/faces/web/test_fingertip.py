"""What pages that render the vibration are sent, without a browser."""

import asyncio
import socket
import time
from contextlib import closing
from uuid import uuid4

import numpy as np
from aiohttp import ClientWebSocketResponse, web
from aiohttp.test_utils import TestClient, TestServer

from tactophone.core.types import (
    AudioBlock,
    HapticCommand,
    PipelineStep,
    Prediction,
    Touch,
)
from tactophone.faces.web.devices import Fingertips, command_of
from tactophone.faces.web.feed import WatchedRun
from tactophone.live.telemetry.layout import FingerState, RunState
from tactophone.live.telemetry.watcher import Watcher
from tactophone.live.telemetry.writer import Telemetry
from tests.faces.web.test_message import parse

NAME = f"test-fingertip-hand-{uuid4().hex[:8]}"
"""Of the run: another in each process, as tests may run side by side."""


def publish(telemetry: Telemetry, finger: int, amplitude: float) -> None:
    prediction = Prediction((0, 0, 1), Touch.ROUGH, 1.0, -20.0, 0, 0)
    block = AudioBlock(np.zeros((480, 2), np.float32), 48_000)
    step = PipelineStep(
        block, (prediction,), (HapticCommand(amplitude, 60.0, 0.0),), finger
    )
    telemetry.publish(step, now=time.monotonic())


async def felt(telemetry: Telemetry) -> list[list[float]]:
    """Return the first command that a page of each finger is sent, once both are
    connected."""
    app = web.Application()
    app.router.add_get("/feel", Fingertips(WatchedRun(NAME)).connect)
    async with TestClient(TestServer(app)) as client:
        views = [await client.ws_connect(f"/feel?finger={finger}") for finger in (0, 1)]
        for view in views:
            await asyncio.wait_for(view.receive(), 10)  # the state
            await view.send_str("ok")
        for finger, amplitude in enumerate((0.25, 0.5)):
            publish(telemetry, finger, amplitude)
        found = []
        for view in views:
            command = None
            while command is None:
                message = await asyncio.wait_for(view.receive(), 10)
                await view.send_str("ok")
                command = parse(message.data)[0]["command"]
            found.append(command)
        return found


def test_a_page_renders_the_finger_that_it_shows() -> None:
    fingers = tuple(FingerState(name, armed=True) for name in ("thumb", "index"))
    with Telemetry(NAME, fingers=2) as telemetry:
        telemetry.update(RunState(fingers=fingers), now=time.monotonic())
        assert asyncio.run(felt(telemetry)) == [[0.25, 1.0, 60.0], [0.5, 1.0, 60.0]]


def masked(data: bytes, kind: int = 1) -> bytes:
    """Return a short frame of a client (RFC 6455), masked with zeros."""
    return bytes([0x80 | kind, 0x80 | len(data)]) + bytes(4) + data


async def join_without_reading(port: int) -> socket.socket:
    """Connect a page that answers whatever comes, and reads none of it."""
    page = socket.socket()
    page.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4_096)
    page.setblocking(False)
    loop = asyncio.get_running_loop()
    await loop.sock_connect(page, ("127.0.0.1", port))
    upgrade = (
        "GET /feel HTTP/1.1\r\nHost: a\r\nUpgrade: websocket\r\n"
        "Connection: Upgrade\r\nSec-WebSocket-Version: 13\r\n"
        "Sec-WebSocket-Key: MDEyMzQ1Njc4OTAxMjM0NQ==\r\n\r\n"
    )
    await loop.sock_sendall(page, upgrade.encode())
    return page


async def last_felt_beside_a_page_that_reads_nothing(telemetry: Telemetry) -> float:
    """Return the last amplitude that a page is sent while another of its finger says
    that it has read all it gets, and reads nothing."""
    app = web.Application()
    app.router.add_get("/feel", Fingertips(WatchedRun(NAME)).connect)
    amplitude = 0.0

    async def follow(view: ClientWebSocketResponse) -> None:
        nonlocal amplitude
        async for message in view:
            await view.send_str("ok")
            if command := parse(message.data)[0]["command"]:
                amplitude = command[0]

    server = TestServer(app)
    async with TestClient(server) as client:
        assert server.port
        with closing(await join_without_reading(server.port)) as page:
            following = asyncio.create_task(follow(await client.ws_connect("/feel")))
            # Far more than the system holds for a connection.
            for count in range(600):
                telemetry.rendered(np.zeros(7_000, np.float32))
                publish(telemetry, 0, count / 1_000)
                await asyncio.get_running_loop().sock_sendall(page, masked(b"ok"))
                await asyncio.sleep(0.005)
            publish(telemetry, 0, 0.75)
            until = time.monotonic() + 5
            while amplitude != 0.75 and time.monotonic() < until:
                await asyncio.sleep(0.01)
            following.cancel()
        return amplitude


def test_a_page_that_answers_and_reads_nothing_keeps_no_other_waiting() -> None:
    finger = FingerState(armed=True)
    with Telemetry(NAME) as telemetry:
        telemetry.update(RunState(fingers=(finger,)), now=time.monotonic())
        felt = asyncio.run(last_felt_beside_a_page_that_reads_nothing(telemetry))
        assert felt == 0.75


def test_a_page_buzzes_with_the_run_and_only_while_that_renders() -> None:
    finger = FingerState(armed=True, ceiling=0.4, output_level=0.5, buzzing=True)
    with Telemetry(NAME) as telemetry:
        telemetry.update(RunState(fingers=(finger,)), now=time.monotonic())
        watcher = Watcher(NAME)
        before = watcher.snapshot()
        assert command_of(watcher.snapshot(before), before)["command"] is None
        telemetry.rendered(np.zeros(480, np.float32))
        felt = command_of(watcher.snapshot(before), before)["command"]
        assert felt == [0.2, 1.0, 0.0]
