"""The stone box over the live system: finger, encrypted link, detector, oscillator,
browser."""

import json
import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
from selenium import webdriver
from selenium.webdriver.common.by import By

from tactophone.core.types import Touch
from tactophone.live.telemetry.watcher import Watcher
from tactophone_lab.simulation.takes import shuffled
from tests.browser import browser, chromium, stroke, text, wait

__all__ = ["browser", "chromium"]

pytestmark = pytest.mark.realtime

SEED = 3


@pytest.fixture
def results(tmp_path: Path) -> Path:
    return tmp_path / "results.jsonl"


@pytest.fixture
def address(results: Path) -> Iterator[str]:
    """A running ``tactophone play``; its page's address."""
    command = [
        sys.executable,
        "-m",
        "tactophone",
        "play",
        "--seed",
        str(SEED),
        "--results",
        str(results),
    ]
    with subprocess.Popen(
        [*command, "--name", "test-play"], stderr=subprocess.PIPE, text=True
    ) as process:
        assert process.stderr
        lines = iter(process.stderr.readline, "")
        yield (
            next(line for line in lines if line.startswith("page: "))
            .removeprefix("page: ")
            .strip()
        )
        process.send_signal(signal.SIGINT)
        assert process.wait(10) == 130


def test_a_round_is_played_through_the_live_system(
    browser: webdriver.Chrome, address: str, results: Path
) -> None:
    browser.get(address)
    wait(browser, lambda: browser.find_element(By.ID, "begin").is_enabled(), 20)
    browser.find_element(By.ID, "begin").click()
    time.sleep(2)  # until the new stones are in place
    watcher, rough_share = Watcher("test-play"), {Touch.SMOOTH: 0.0, Touch.ROUGH: 0.0}
    for stone, label in enumerate(shuffled(SEED)):
        before = watcher.snapshot()
        stroke(browser, stone, step=80)
        steps = watcher.snapshot(before).steps
        rough_share[label] += float(np.mean(steps["touch"] == Touch.ROUGH)) / (
            2 if label is Touch.ROUGH else 3
        )
        time.sleep(0.5)
    assert rough_share[Touch.ROUGH] > rough_share[Touch.SMOOTH]
    for mark in browser.find_elements(By.CSS_SELECTOR, "#marks button")[:2]:
        mark.click()
    browser.find_element(By.ID, "done").click()
    wait(browser, lambda: text(browser, "verdict") != "")
    result = json.loads(results.read_text())
    assert result["order"] == [touch.name.lower() for touch in shuffled(SEED)]
    assert min(result["strokes"]) >= 1
    browser.get("about:blank")  # before its server ends
