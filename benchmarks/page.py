"""The page as the fingertip, in headless Chromium on loopback: delays to motor and
sound, and to silence.

``python benchmarks/page.py [delays] [deadman] [microphone] [viewers] [game] [alone]``
runs the named parts, or all.

- ``delays``: a run alternates between no contact and rough. From the moment at which
  the command is published to the call of ``navigator.vibrate`` or ``playEffect``, and
  to the first sample of sound in the audio thread.
- ``deadman``: the run is killed while it vibrates; until the pad's motors are reset.
- ``microphone``: clicks in the microphone of a page (``tactophone try``), to the motor
  of another page.
- ``viewers``: latency of a loopback with no viewer and with ten that render the
  vibration.
- ``game``: from a press on a rough stone to the first sample of sound, over the live
  system (``tactophone play``).
- ``alone``: processor time of the page that listens (``tactophone listen``), all of
  Chromium's processes together.

Needs Debian's chromium and chromium-driver. A motor is replaced by a function that
notes the time.
"""

import argparse
import asyncio
import contextlib
import functools
import http.server
import shutil
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Iterator
from multiprocessing import get_context
from pathlib import Path

import aiohttp
import numpy as np
import psutil
import soundfile
from selenium import webdriver
from selenium.webdriver.chrome.service import Service
from selenium.webdriver.common.action_chains import ActionChains
from selenium.webdriver.common.by import By

from tactophone.app.listen import write_listening_site
from tactophone.core.types import (
    AudioBlock,
    HapticCommand,
    PipelineStep,
    Prediction,
    Touch,
)
from tactophone.faces.web.server import watch
from tactophone.live.telemetry.layout import FingerState, RunState
from tactophone.live.telemetry.watcher import Watcher
from tactophone.live.telemetry.writer import Telemetry

RATE = 48_000
"""Sample rate in Hz."""

STEP = 480
"""Samples in a step: 10 ms."""

START_TIMEOUT = 60.0
"""Seconds within which a run has to begin; on a busy machine its processes start
late."""

REPEATS = 20
"""How often each delay is measured."""

PAD = """
window.noted = [];
const wall = () => performance.timeOrigin + performance.now();
const pad = { connected: true, vibrationActuator: {
  playEffect: async () => { window.noted.push(["play", wall()]); },
  reset: async () => { window.noted.push(["reset", wall()]); },
} };
navigator.getGamepads = () => [pad];
"""
PHONE = """
window.noted = [];
Object.defineProperty(navigator, "userAgentData", { get: () => ({ mobile: true }) });
navigator.vibrate = (train) => {
  const now = performance.timeOrigin + performance.now();
  window.noted.push([train ? "play" : "reset", now]);
  return true;
};
"""
SOUND = """
window.noted = [];
const post = AudioWorkletNode;
window.AudioWorkletNode = class extends post {
  constructor(context, ...rest) {
    super(context, ...rest);
    this.port.addEventListener("message", ({ data }) => {
      const late = 1000 * (context.currentTime - data.time);
      window.noted.push(["play", performance.timeOrigin + performance.now() - late]);
    });
  }
};
"""


@contextlib.contextmanager
def chromium(*flags: str) -> Iterator[webdriver.Chrome]:
    options = webdriver.ChromeOptions()
    options.binary_location = shutil.which("chromium") or "chromium"
    common = (
        "headless=new",
        "no-sandbox",
        "disable-gpu",
        "disable-dev-shm-usage",
        "window-size=1280,900",
        "mute-audio",
    )
    for flag in (*common, "autoplay-policy=no-user-gesture-required", *flags):
        options.add_argument(f"--{flag}")
    browser = webdriver.Chrome(options, Service(shutil.which("chromedriver")))
    try:
        yield browser
    finally:
        browser.quit()


def inject(browser: webdriver.Chrome, script: str) -> None:
    browser.execute_cdp_cmd("Page.addScriptToEvaluateOnNewDocument", {"source": script})


def noted(browser: webdriver.Chrome, kind: str, since: float) -> float:
    """Return the wall time in s of the first note of a kind after a moment; waits for
    it, NaN after 2 s."""
    until = time.time() + 2
    while time.time() < until:
        for name, moment in browser.execute_script("return window.noted"):
            if name == kind and moment / 1000 >= since:
                return float(moment) / 1000
        time.sleep(0.02)
    return float("nan")


def step(telemetry: Telemetry, number: int, touch: Touch) -> None:
    """Publish 10 ms of a run that touches something rough, or nothing."""
    times = (number * STEP + np.arange(STEP)) / RATE
    amplitude = 0.5 * (touch is Touch.ROUGH)
    prediction = Prediction((0.1, 0.1, 0.8), touch, 0.9, -30.0, times[0], times[-1])
    block = AudioBlock(np.zeros((STEP, 2), np.float32), RATE, number * STEP)
    done = PipelineStep(
        block, (prediction,), (HapticCommand(amplitude, 60.0, times[-1]),)
    )
    telemetry.publish(done, now=time.monotonic())
    telemetry.rendered((amplitude * np.sin(2 * np.pi * 60 * times)).astype(np.float32))
    telemetry.update(
        RunState(
            "operator",
            fingers=(FingerState(armed=True, muted_because="", ceiling=0.5),),
        ),
        now=time.monotonic(),
    )


def run(name: str, changes: "object") -> None:
    """Run until killed: 0.4 s of nothing, 0.3 s of rough; put the wall time of each
    change into the queue."""
    with Telemetry(name) as telemetry:
        begin, number, before = time.monotonic(), 0, Touch.NONE
        while True:
            time.sleep(max(0.0, begin + number * STEP / RATE - time.monotonic()))
            touch = Touch.ROUGH if (number % 70) >= 40 else Touch.NONE
            if touch is not before:
                changes.put((int(touch), time.time()))  # type: ignore[attr-defined]
            before = touch
            step(telemetry, number, touch)
            number += 1


@contextlib.contextmanager
def source(name: str) -> Iterator[tuple[object, object]]:
    context = get_context("spawn")
    changes = context.Queue()
    process = context.Process(target=run, args=(name, changes), daemon=True)
    process.start()
    changes.get(timeout=START_TIMEOUT)
    try:
        yield changes, process
    finally:
        process.kill()
        process.join()


def feel(browser: webdriver.Chrome, url: str) -> None:
    browser.get(url)
    time.sleep(1)
    browser.find_element(By.ID, "feel").click()
    time.sleep(1)


def row(name: str, seconds: list[float]) -> None:
    found = 1000 * np.array(seconds)
    missing = int(np.isnan(found).sum())
    found = found[np.isfinite(found)]
    p50, p95 = np.percentile(found, [50, 95]) if len(found) else (np.nan, np.nan)
    print(
        f"| {name} | {len(found)} ({missing} missing) | {p50:.1f} | {p95:.1f} |",
        flush=True,
    )


def delays(repeats: int) -> None:
    for name, script in (
        ("`playEffect`", PAD),
        ("`vibrate`", PHONE),
        ("the first sample of sound", SOUND),
    ):
        with (
            source("bench-page") as (changes, _),
            watch("bench-page") as page,
            chromium() as browser,
        ):
            inject(browser, script)
            feel(browser, page.url)
            found = []
            while not changes.empty():  # type: ignore[attr-defined]
                changes.get()  # type: ignore[attr-defined]
            while len(found) < repeats:
                touch, moment = changes.get(timeout=5)  # type: ignore[attr-defined]
                if touch == Touch.ROUGH:
                    found.append(noted(browser, "play", moment) - moment)
        row(f"command to {name}", found)


def deadman(repeats: int) -> None:
    found = []
    with chromium() as browser:
        inject(browser, PAD)
        for number in range(repeats):
            name = f"bench-page-{number}"
            with source(name) as (changes, process), watch(name) as page:
                feel(browser, page.url)
                while changes.get(timeout=5)[0] != Touch.ROUGH or not changes.empty():  # type: ignore[attr-defined]
                    pass
                time.sleep(0.03)
                process.kill()  # type: ignore[attr-defined]
                killed = time.time()
                found.append(noted(browser, "reset", killed) - killed)
                browser.get("about:blank")
    row("a killed run to silent motors", found)


@contextlib.contextmanager
def tactophone(*arguments: str) -> Iterator[str]:
    """Run a verb; yield its page's address."""
    command = [sys.executable, "-m", "tactophone", *arguments]
    with subprocess.Popen(
        command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True
    ) as process:
        assert process.stderr
        said = []
        try:
            for line in process.stderr:
                said.append(line)
                if line.startswith("page: "):
                    break
            else:
                sys.exit(f"{' '.join(command[1:])} ended:\n{''.join(said)}")
            yield line.split()[1]
        finally:
            # Not SIGINT: whoever runs in the background of a shell ignores it.
            process.terminate()


def microphone(repeats: int) -> None:
    """Bursts of noise, one a second: from the first loud sample at the listening page
    to the other page's motor."""
    rng = np.random.default_rng(1)
    burst = (np.arange(RATE) % RATE < RATE // 3) * rng.uniform(-0.8, 0.8, RATE)
    with tempfile.TemporaryDirectory() as folder:
        path = Path(folder) / "bursts.wav"
        soundfile.write(path, np.tile(burst, 10).astype(np.float32), RATE)
        fake = ("use-fake-ui-for-media-stream", "use-fake-device-for-media-stream")
        with (
            tactophone("try", "--no-open", "--name", "bench-try") as url,
            chromium(*fake, f"use-file-for-fake-audio-capture={path}") as listener,
            chromium() as finger,
        ):
            inject(finger, PHONE)
            inject(listener, LOUD)
            feel(finger, url)
            listener.get(url)
            time.sleep(3)
            listener.find_element(By.ID, "listen").click()
            time.sleep(repeats + 3)
            loud = np.array(listener.execute_script("return window.loud")) / 1000
            played = np.array(
                [
                    when
                    for kind, when in finger.execute_script("return window.noted")
                    if kind == "play"
                ]
            )
    played = played / 1000
    # Of each burst, the first call of the motor after it began.
    found = [
        float(played[played >= moment].min(initial=np.inf)) - moment
        for moment in loud[1:]
    ]
    row(
        "a page's microphone to the motor of another page",
        [f if f < 0.5 else float("nan") for f in found],
    )


LOUD = """
window.loud = [];
const send = WebSocket.prototype.send;
let quiet = 0;
WebSocket.prototype.send = function (data) {
  if (data instanceof ArrayBuffer) {
    const samples = new Float32Array(data, 4);
    const at = samples.findIndex((sample) => Math.abs(sample) > 0.05);
    if (at < 0) quiet += samples.length;
    else {
      // The message is sent when its last sample has arrived.
      const arrived = performance.timeOrigin + performance.now();
      const now = arrived - (samples.length - at) / 48;
      if (quiet > 12000) window.loud.push(now);
      quiet = 0;
    }
  }
  return send.call(this, data);
};
"""


async def _render(url: str, seconds: float) -> None:
    async with aiohttp.ClientSession() as session:
        origin = url[: url.rindex("/", 0, -1)]
        view = await session.ws_connect(f"{url}feel?v=1", origin=origin)
        until = time.monotonic() + seconds
        while time.monotonic() < until:
            await view.receive()
            await view.send_str("ok")


def _viewers(url: str, seconds: float) -> None:
    async def ten() -> None:
        await asyncio.gather(*(_render(url, seconds) for _ in range(10)))

    asyncio.run(ten())


def await_run(name: str) -> Watcher:
    """Return a watcher of a run that predicts."""
    until = time.monotonic() + START_TIMEOUT
    while time.monotonic() < until:
        watcher = Watcher.find(name)
        if watcher is not None and watcher.totals()[0]["predictions"]:
            return watcher
        time.sleep(0.1)
    sys.exit(f"{name} has predicted nothing within {START_TIMEOUT:.0f} s")


def viewers(_: int) -> None:
    arguments = (
        "loopback",
        "--source",
        "finger",
        "--actuator",
        "none",
        "--set",
        "link.packet_duration=0.0025",
        "--dashboard",
    )
    found: dict[int, list[float]] = {0: [], 10: []}
    with tactophone(*arguments, "--name", "bench-viewers") as url:
        run = await_run("bench-viewers")
        time.sleep(5)
        for turn in range(6):
            count = 10 * (turn % 2)
            process = get_context("spawn").Process(
                target=_viewers, args=(url, 10.0), daemon=True
            )
            if count:
                process.start()
            time.sleep(3)
            until = time.monotonic() + 6
            while time.monotonic() < until:
                found[count].append(run.gauge("latency_total"))
                time.sleep(0.5)
            if count:
                process.join()
                if process.exitcode:
                    sys.exit("the viewers could not watch the page")
    for count, totals in found.items():
        row(f"latency of the run, {count or 'without'} viewers", totals)


def game(repeats: int) -> None:
    with tempfile.TemporaryDirectory() as folder, chromium() as browser:
        results = str(Path(folder) / "results.jsonl")
        with tactophone(
            "play",
            "--no-open",
            "--seed",
            "3",
            "--name",
            "bench-play",
            "--results",
            results,
        ) as url:
            browser.get(url)
            until = time.monotonic() + 40
            while (
                not browser.find_element(By.ID, "begin").is_enabled()
                and time.monotonic() < until
            ):
                time.sleep(0.2)
            browser.find_element(By.ID, "begin").click()
            time.sleep(3)
            stage = browser.find_element(By.ID, "stage")
            found: list[float] = []
            for number in range(repeats):
                width = stage.rect["width"]
                along = int(width * ((0.0575 + 0.11 * (number % 5)) / 0.555 - 0.5))
                actions = (
                    ActionChains(browser, duration=60)
                    .move_to_element_with_offset(stage, along, 0)
                    .click_and_hold()
                )
                for side in (8, -8, 8):
                    actions.move_by_offset(side, 0)
                actions.release().perform()
                time.sleep(0.7)
                words = browser.find_element(By.ID, "delay").text
                if words:
                    found.append(float(words.split(":")[1].split("ms")[0]) / 1000)
    row("press to sound in the stone box", found)


def alone(_: int) -> None:
    """Bursts of noise through the browser's own false microphone, 10 s at a time after
    6 s of warming."""
    with tempfile.TemporaryDirectory() as folder:
        write_listening_site(Path(folder))
        at = np.arange(60 * RATE) / RATE
        hiss = np.random.default_rng(1).standard_normal(len(at))
        soundfile.write(
            Path(folder) / "bursts.wav", np.where(at % 1 < 0.6, 0.05, 1e-3) * hiss, RATE
        )
        server = http.server.ThreadingHTTPServer(
            ("127.0.0.1", 0), functools.partial(_Silent, directory=folder)
        )
        threading.Thread(target=server.serve_forever, daemon=True).start()
        flags = ("use-fake-ui-for-media-stream", "use-fake-device-for-media-stream")
        with chromium(
            *flags, f"use-file-for-fake-audio-capture={folder}/bursts.wav"
        ) as browser:
            browser.get(
                f"http://127.0.0.1:{server.server_port}/index.html?threshold=-45"
            )
            button = browser.find_element(By.ID, "listen")
            while not button.is_enabled():
                time.sleep(0.1)
            button.click()
            time.sleep(6)
            shares = []
            for _ in range(3):
                used, begun = _processor_time(browser), time.monotonic()
                time.sleep(10)
                shares.append(
                    (_processor_time(browser) - used) / (time.monotonic() - begun)
                )
        server.shutdown()
    print("\n| processor time of a core | median | highest of 3 |\n|---|--:|--:|")
    print(
        f"| the page that listens, all of Chromium | {np.median(shares):.1%} "
        f"| {max(shares):.1%} |"
    )


class _Silent(http.server.SimpleHTTPRequestHandler):
    def log_message(self, *_: object) -> None:
        pass


def _processor_time(browser: webdriver.Chrome) -> float:
    driver = psutil.Process(browser.service.process.pid)
    return sum(sum(each.cpu_times()[:2]) for each in driver.children(recursive=True))


PARTS = {
    "delays": delays,
    "deadman": deadman,
    "microphone": microphone,
    "viewers": viewers,
    "game": game,
    "alone": alone,
}


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "parts",
        nargs="*",
        metavar="PART",
        help=f"what to measure, of {', '.join(PARTS)} (default: all of them)",
    )
    parser.add_argument(
        "--repeats", type=int, default=REPEATS, help="of each delay (default: 20)"
    )
    args = parser.parse_args()
    unknown = sorted(set(args.parts) - set(PARTS))
    if unknown:
        parser.error(f"no part {unknown[0]!r}; the parts are {', '.join(PARTS)}")
    chosen = args.parts or list(PARTS)
    if set(chosen) - {"alone"}:
        print("| from, to | measured | p50 ms | p95 ms |\n|---|---:|---:|---:|")
    for name in chosen:
        PARTS[name](args.repeats)


if __name__ == "__main__":
    main()
