"""A run, its page, and a browser to look at it with."""

import os
import shutil
from collections.abc import Iterator

import pytest
from selenium import webdriver
from selenium.webdriver.chrome.service import Service

from tactophone.dashboard import Page, watch
from tests.dashboard.running import Run

FLAGS = ("--headless=new", "--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage", "--mute-audio", "--no-first-run")
"""No sandbox, because containers forbid it its name spaces; it only ever sees our own page."""


@pytest.fixture
def run() -> Iterator[Run]:
    """A run that is shown."""
    with Run(f"test-page-{os.getpid()}") as run:
        yield run


@pytest.fixture
def page(run: Run) -> Iterator[Page]:
    """Its page."""
    with watch(run.telemetry.name) as page:
        yield page


@pytest.fixture(scope="session")
def chromium() -> Iterator[webdriver.Chrome]:
    """A browser, without a window; the tests that need it are skipped where Debian's packages are missing."""
    program, driver = shutil.which("chromium"), shutil.which("chromedriver")
    if program is None or driver is None:
        pytest.skip("no chromium and chromedriver here: scripts/system-packages installs them")
    options = webdriver.ChromeOptions()
    options.binary_location = program
    for flag in (*FLAGS, "--autoplay-policy=no-user-gesture-required"):
        options.add_argument(flag)
    options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
    browser = webdriver.Chrome(options, Service(driver))
    yield browser
    browser.quit()


@pytest.fixture
def browser(chromium: webdriver.Chrome) -> Iterator[webdriver.Chrome]:
    """The browser, at a laptop's size; whatever it complained about fails the test."""
    chromium.get_log("browser")
    resize(chromium, 1280, 900)
    yield chromium
    chromium.get("about:blank")
    assert [entry["message"] for entry in chromium.get_log("browser")] == []


def resize(browser: webdriver.Chrome, width: int, height: int) -> None:
    """Take the size of a window, or of a phone."""
    phone = width < 500
    metrics = {"width": width, "height": height, "deviceScaleFactor": 2 if phone else 1, "mobile": phone}
    browser.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", metrics)
