"""Effect of the dashboard on latency: page closed, open in a browser, and open in a stalled browser.

One run of ``tactophone loopback`` (simulated finger, Opus 2.5 ms, encrypted, no actuator). The three states alternate,
so that other load on the machine affects all equally. Latency is the time from a packet's capture to the first
rendering that uses it, by the marks in telemetry. Needs Debian's chromium and chromium-driver.
"""

import itertools
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager, nullcontext

import numpy as np
import psutil
from selenium import webdriver
from selenium.webdriver.chrome.service import Service

from tactophone.telemetry import Watcher

NAME = "bench-dashboard"
STATES = ("closed", "open", "stalled")
TURNS = 3
TURN = 8.0
"""Seconds; telemetry keeps the marks of the last ten."""

SETTLE = 2.0
"""Seconds after a change that are not counted, while a page starts or stops."""

DRAWN = (
    "const done = arguments[0], times = []; const note = (t) => { times.push(t);"
    "times.length < 121 ? requestAnimationFrame(note) : done(times); }; requestAnimationFrame(note);"
)


@contextmanager
def loopback() -> Iterator[str]:
    """Run both sides; yield the page's address."""
    command = [sys.executable, "-m", "tactophone", "loopback", "--source", "finger", "--actuator", "none"]
    command += ["--packet-duration", "0.0025", "--name", NAME, "--dashboard"]
    with subprocess.Popen(command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True) as process:
        assert process.stderr
        yield next(line for line in process.stderr if line.startswith("page: ")).split()[1]
        process.send_signal(signal.SIGINT)


@contextmanager
def chromium() -> Iterator[tuple[webdriver.Chrome, psutil.Process]]:
    """Start a headless browser; yield it and the parent of all its processes."""
    options = webdriver.ChromeOptions()
    options.binary_location = shutil.which("chromium") or "chromium"
    for flag in ("headless=new", "no-sandbox", "disable-gpu", "disable-dev-shm-usage", "window-size=1280,900"):
        options.add_argument(f"--{flag}")
    service = Service(shutil.which("chromedriver"))
    browser = webdriver.Chrome(options, service)
    try:
        yield browser, psutil.Process(service.process.pid)
    finally:
        browser.quit()


@contextmanager
def stalled(root: psutil.Process) -> Iterator[None]:
    """Suspend every process of the browser."""
    processes = root.children(recursive=True)
    for process in processes:
        process.suspend()
    try:
        yield
    finally:
        for process in processes:
            process.resume()


def delays(since: float) -> np.ndarray:
    """Return the seconds from capture to rendering, of everything rendered since a moment."""
    captured = Watcher(f"{NAME}-robot").marks("captured")
    rendered = Watcher(NAME).marks("rendered")
    rendered = rendered[rendered["time"] >= since]
    order = np.argsort(captured["position"])
    captured = captured[order]
    at = np.searchsorted(captured["position"], rendered["position"])
    known = at < len(captured)
    found = rendered["time"][known] - captured["time"][at[known]]
    return found[(found > 0) & (found < 1)]


def measure(state: str, browser: webdriver.Chrome, root: psutil.Process, address: str) -> np.ndarray:
    """Put the page into a state for a turn; return the delays measured."""
    browser.get("about:blank" if state == "closed" else address)
    time.sleep(SETTLE)
    with stalled(root) if state == "stalled" else nullcontext():
        begin = time.monotonic()
        time.sleep(TURN)
        return delays(begin)


def main() -> None:
    found: dict[str, list[np.ndarray]] = {state: [] for state in STATES}
    with loopback() as address, chromium() as (browser, root):
        time.sleep(3)
        for _, state in itertools.product(range(TURNS), STATES):
            found[state].append(measure(state, browser, root, address))
        browser.get(address)
        time.sleep(SETTLE)
        frames = np.diff(browser.execute_async_script(DRAWN))
    print("| page | packets | p50 ms | p95 ms | p99 ms | p50, closed = 1 | goal |")
    print("|---|---:|---:|---:|---:|---:|---|")
    closed = np.median(np.concatenate(found["closed"]))
    for state in STATES:
        all_delays = 1e3 * np.concatenate(found[state])
        p50, p95, p99 = np.percentile(all_delays, [50, 95, 99])
        row = f"| {state} | {len(all_delays)} | {p50:.2f} | {p95:.2f} | {p99:.2f} | {p50 / 1e3 / closed:.2f}"
        print(f"{row} | {'' if state == 'closed' else '0.95 to 1.05'} |")
    rate, apart = 1000 / np.median(frames), np.percentile(frames, 95)
    print(f"\nThe open page draws {rate:.0f} frames a second (goal: 60), {apart:.0f} ms apart at p95.")


if __name__ == "__main__":
    main()
