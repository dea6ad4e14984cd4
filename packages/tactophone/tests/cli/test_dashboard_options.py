"""The operator's page over the real pipeline: its controls act on the actuator."""

import signal
import subprocess
import sys
import time
from collections.abc import Iterator
from uuid import uuid4

import numpy as np
import pytest
from selenium import webdriver
from selenium.webdriver.common.by import By

from tactophone.live.telemetry.watcher import Watcher
from tests.browser import browser, chromium, text, wait

__all__ = ["browser", "chromium"]

pytestmark = pytest.mark.realtime

NAME = f"test-page-loopback-{uuid4().hex[:8]}"
"""Of the run: another in each process, as tests may run side by side."""


@pytest.fixture(scope="module")
def address() -> Iterator[str]:
    """A running ``tactophone loopback --dashboard``, the same for all tests; its page's
    address."""
    command = [
        sys.executable,
        "-m",
        "tactophone",
        "loopback",
        "--source",
        "finger",
        "--actuator",
        "none",
    ]
    # No watchdog: on a busy machine it would end the operator's side in the middle of
    # the test.
    command += ["--dashboard", "--name", NAME, "--set", "process.watchdog=false"]
    with subprocess.Popen(
        command, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True
    ) as process:
        assert process.stderr
        lines = iter(process.stderr.readline, "")
        yield next(line for line in lines if line.startswith("page: ")).split()[1]
        process.send_signal(signal.SIGINT)
        process.wait(10)


def strength(watcher: Watcher) -> float:
    """The vibration's greatest sample of the last quarter of a second."""
    return float(np.abs(watcher.snapshot().vibration[-12_000:]).max())


def test_mute_silences_the_actuator_until_somebody_arms(
    browser: webdriver.Chrome, address: str
) -> None:
    browser.get(address)
    wait(browser, lambda: text(browser, "life") == "live", 40)
    watcher = Watcher(NAME)
    wait(browser, lambda: strength(watcher) > 0, 30)
    browser.find_element(By.ID, "mute").click()
    wait(browser, lambda: text(browser, "life") == "muted")
    time.sleep(0.5)
    until = time.monotonic() + 3
    while time.monotonic() < until:
        assert strength(watcher) == 0.0
        time.sleep(0.1)
    assert not watcher.snapshot().state.armed
    browser.find_element(By.ID, "mute").click()
    wait(browser, lambda: strength(watcher) > 0, 30)
    browser.get("about:blank")  # before its server goes


def test_a_ceiling_lowered_on_the_page_bounds_the_vibration(
    browser: webdriver.Chrome, address: str
) -> None:
    browser.get(address)
    wait(browser, lambda: text(browser, "life") == "live", 40)
    watcher = Watcher(NAME)
    browser.execute_script(
        "const slider = document.getElementById('ceiling'); slider.value = 0.03;"
        "slider.dispatchEvent(new Event('change', { bubbles: true }));"
    )
    wait(
        browser,
        lambda: watcher.snapshot().state.fingers[0].ceiling == pytest.approx(0.03),
    )
    time.sleep(0.5)
    wait(browser, lambda: strength(watcher) > 0, 30)
    assert strength(watcher) <= 0.03 + 1e-6
    wait(
        browser,
        lambda: browser.find_element(By.ID, "ceiling").get_attribute("max") == "0.03",
    )
    browser.get("about:blank")
