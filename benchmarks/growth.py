"""How cost grows with fingers, viewers, bridge topics, log length, files and
hours: processor time at several sizes, and the exponent.

    python benchmarks/growth.py [--only fingers,viewers]

An exponent of 1 is proportional, under 1 each further one costs less, and over 1 it
costs more. It is the slope of the logarithm of the cost over the logarithm of the size,
so what is paid once, whatever the size, lowers it. Each figure is the least of three
measurements of processor time, as other work on a machine adds to it; `feel` is
measured once. `scale.py --operators 1,2,4` measures the operators of one robot.
"""

import argparse
import asyncio
import os
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from pathlib import Path

import aiohttp
import numpy as np
import psutil
import soundfile

from tactophone.core.settings import Settings
from tactophone.core.types import LIVE_SAMPLE_RATE, AudioBlock, PipelineStep
from tactophone.faces.bridges.foxglove import PROTOCOLS, FoxgloveBridge
from tactophone.faces.web.server import watch
from tactophone.live.log.mcap import McapLog, read_log
from tactophone.live.runtime.recorder import SessionRecorder
from tactophone.live.telemetry.layout import FingerState, RunState
from tactophone.live.telemetry.writer import Telemetry
from tactophone.signal.pipeline import Hand, open_pipeline
from tactophone_lab.measurement.port_sounds import strokes

REPEATS = 3

SHOWN_FOR = 4.0
"""Seconds for which viewers watch."""

STEP_INTERVAL = 0.01
"""Seconds between two predictions of a run that is watched."""


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--only", default=",".join(PARTS), help="parts (default: %(default)s)"
    )
    args = parser.parse_args()
    print("| what | cost at each size | exponent | load |")
    print("|---|---|--:|--:|")
    for name in args.only.split(","):
        unit, costs = PARTS[name]()
        sizes = list(costs)
        shown = ", ".join(f"{size:g}: {cost:.3g}" for size, cost in costs.items())
        slope = np.polyfit(np.log(sizes), np.log(list(costs.values())), 1)[0]
        load = os.getloadavg()[0]
        print(f"| {name}: {unit} | {shown} | {slope:.2f} | {load:.0f} |", flush=True)


def least(measure: Callable[[], float]) -> float:
    return min(measure() for _ in range(REPEATS))


def fingers() -> tuple[str, dict[float, float]]:
    """Return the ms of the operator's detectors for a second of strokes."""

    def measure(count: int) -> float:
        hand = Hand(
            [
                open_pipeline(sample_rate=LIVE_SAMPLE_RATE, channels=2)
                for _ in range(count)
            ]
        )
        sound = np.ascontiguousarray(strokes(2 * count).T)
        seconds = len(sound) / LIVE_SAMPLE_RATE
        began = time.process_time()
        for start in range(0, len(sound), 240):
            block = AudioBlock(sound[start : start + 240], LIVE_SAMPLE_RATE, start)
            list(hand.push(block))
        return 1_000 * (time.process_time() - began) / seconds

    sizes = (1, 2, 5, 10)
    return "ms of detection a second of strokes, by fingers", {
        size: least(lambda size=size: measure(size)) for size in sizes
    }


def viewers() -> tuple[str, dict[float, float]]:
    """Return the percent of a core that the page's process takes."""

    def measure(count: int) -> float:
        name = f"growth-{os.getpid()}-{count}"
        with run_of_name(name) as telemetry, watch(name) as page:
            url = page.url.replace("http", "ws", 1).rstrip("/") + "/live"
            before = children_time()
            began = time.monotonic()
            asyncio.run(watch_page(telemetry, url, count))
            return 100 * (children_time() - before) / (time.monotonic() - began)

    return "percent of a core of the page's process, by viewers", {
        size: least(lambda size=size: measure(size)) for size in (1, 4, 16)
    }


async def watch_page(telemetry: Telemetry, url: str, count: int) -> None:
    async with aiohttp.ClientSession() as session:
        # As a browser does, which has the page from there.
        origin = url.replace("ws", "http", 1).split("/", 3)
        headers = {"Origin": "/".join(origin[:3])}
        views = [await session.ws_connect(url, headers=headers) for _ in range(count)]

        async def read(view: aiohttp.ClientWebSocketResponse) -> None:
            async for _ in view:
                pass

        reading = [asyncio.ensure_future(read(view)) for view in views]
        await publish(telemetry)
        for each in reading:
            each.cancel()


def topics() -> tuple[str, dict[float, float]]:
    """Return the percent of a core of a Foxglove bridge with one viewer."""

    async def watched(bridge: FoxgloveBridge, telemetry: Telemetry, count: int) -> None:
        url = f"ws://127.0.0.1:{bridge.port}/growth/"
        async with (
            aiohttp.ClientSession() as session,
            session.ws_connect(url, protocols=[PROTOCOLS[0]]) as view,
        ):
            await view.receive()
            channels = (await view.receive_json())["channels"]
            chosen = [channels[at % len(channels)]["id"] for at in range(count)]
            subscriptions = [
                {"id": at, "channelId": channel} for at, channel in enumerate(chosen)
            ]
            await view.send_json({"op": "subscribe", "subscriptions": subscriptions})
            await publish(telemetry, bridge.read)

    def measure(count: int) -> float:
        name = f"growth-{os.getpid()}-{count}"
        with (
            run_of_name(name) as telemetry,
            FoxgloveBridge(name, "127.0.0.1:0", token="growth") as bridge,
        ):
            before, began = time.process_time(), time.monotonic()
            asyncio.run(watched(bridge, telemetry, count))
            elapsed = time.monotonic() - began
            return 100 * (time.process_time() - before) / elapsed

    return "percent of a core of bridge, viewer and run, by topics", {
        size: least(lambda size=size: measure(size)) for size in (1, 2, 4, 8)
    }


def log() -> tuple[str, dict[float, float]]:
    """Return the seconds to read a log."""

    def measure(count: int) -> float:
        name = f"growth-{os.getpid()}-{count}"
        with tempfile.TemporaryDirectory() as folder:
            path = Path(folder) / "run.mcap"
            with run_of_name(name) as telemetry, McapLog(name, path) as kept:
                for number, step in enumerate(steps_of(count)):
                    telemetry.publish(step, now=time.monotonic())
                    if number % 20 == 0:
                        kept.read()
                kept.read()
            began = time.process_time()
            for _ in read_log(path):
                pass
            return time.process_time() - began

    return "s to read a log, by predictions", {
        size: least(lambda size=size: measure(size)) for size in (2_000, 8_000, 32_000)
    }


def files() -> tuple[str, dict[float, float]]:
    return "s of `feel`, by files of a second in one call", felt(
        [(1.0, size) for size in (10, 40, 160)]
    )


def hours() -> tuple[str, dict[float, float]]:
    return "s of `feel`, by minutes of one recording", felt(
        [(60.0 * size, 1) for size in (1, 4, 16)]
    )


def felt(recordings: list[tuple[float, int]]) -> dict[float, float]:
    """Return the processor time of the verb for so many recordings of so many
    seconds."""
    found: dict[float, float] = {}
    for seconds, count in recordings:
        with tempfile.TemporaryDirectory() as name:
            folder = Path(name)
            sound = strokes(2).T
            whole = np.tile(sound, (round(seconds * LIVE_SAMPLE_RATE / len(sound)), 1))
            for number in range(count):
                part = whole if count == 1 else sound[: round(seconds * 48_000)]
                soundfile.write(folder / f"{number}.flac", part, LIVE_SAMPLE_RATE)
            command = [sys.executable, "-m", "tactophone", "feel"]
            paths = [str(path) for path in sorted(folder.glob("*.flac"))]
            before = children_time()
            subprocess.run(
                [*command, *paths, "--out", name],
                check=True,
                stdout=subprocess.DEVNULL,
                stderr=subprocess.DEVNULL,
            )
            found[float(count) if count > 1 else seconds / 60] = (
                children_time() - before
            )
    return found


def run_of_name(name: str) -> ExitStack:
    """Return a run that publishes nothing yet; a context manager that yields its
    telemetry."""

    class Run(ExitStack):
        def __enter__(self) -> Telemetry:  # type: ignore[override]
            telemetry = self.enter_context(Telemetry(name))
            SessionRecorder(telemetry, Settings(), role="operator")
            telemetry.update(
                RunState(role="operator", fingers=(FingerState(),)),
                now=time.monotonic(),
            )
            return telemetry

    return Run()


def steps_of(count: int) -> Iterator[PipelineStep]:
    """Yield so many steps with a prediction each."""
    pipeline = open_pipeline(sample_rate=LIVE_SAMPLE_RATE, channels=2)
    sound = np.ascontiguousarray(strokes(2).T)
    made: list[PipelineStep] = []
    for start in range(0, len(sound) - 512, 512):
        block = AudioBlock(sound[start : start + 512], LIVE_SAMPLE_RATE, start)
        step = pipeline.push(block)
        if step.predictions:
            made.append(step)
    for number in range(count):
        yield made[number % len(made)]


async def publish(
    telemetry: Telemetry, then: Callable[[], object] = lambda: None
) -> None:
    """Publish predictions for some seconds, as often as a run does."""
    for step in steps_of(round(SHOWN_FOR / STEP_INTERVAL)):
        telemetry.publish(step, now=time.monotonic())
        then()
        await asyncio.sleep(STEP_INTERVAL)


def children_time() -> float:
    """Return the processor time of this process's children, those that ended too."""
    me = psutil.Process()
    own = me.cpu_times()
    ended = own.children_user + own.children_system
    return ended + sum(
        sum(child.cpu_times()[:2]) for child in me.children(recursive=True)
    )


PARTS: dict[str, Callable[[], tuple[str, dict[float, float]]]] = {
    "fingers": fingers,
    "viewers": viewers,
    "topics": topics,
    "log": log,
    "files": files,
    "hours": hours,
}


if __name__ == "__main__":
    main()
