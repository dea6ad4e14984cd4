"""What pages that render the vibration are sent, without a browser."""

import asyncio
import time
from uuid import uuid4

import numpy as np
from aiohttp import web
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
