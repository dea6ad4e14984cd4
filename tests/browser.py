"""A real browser, without a window, for the tests of pages."""

import math
import shutil
from collections.abc import Callable, Iterator

import pytest
from selenium import webdriver
from selenium.webdriver.chrome.service import Service
from selenium.webdriver.common.actions.action_builder import ActionBuilder
from selenium.webdriver.common.by import By
from selenium.webdriver.support.ui import WebDriverWait

FLAGS = (
    "--headless=new",
    "--no-sandbox",
    "--disable-gpu",
    "--disable-dev-shm-usage",
    "--mute-audio",
    "--no-first-run",
)
"""No sandbox, because containers forbid it its name spaces; it only ever sees our own
page."""

RULES = "MAP phone.test 127.0.0.1, MAP other.test 127.0.0.1"
"""Names that resolve to this machine, but are no secure context as 127.0.0.1 is: as for
a phone."""


@pytest.fixture(scope="session")
def chromium() -> Iterator[webdriver.Chrome]:
    """A browser, without a window; the tests that need it are skipped where there is
    none."""
    browser = start_chromium()
    yield browser
    browser.quit()


def start_chromium(*flags: str) -> webdriver.Chrome:
    """Start a browser with further flags; the caller quits it."""
    program, driver = (
        shutil.which("chromium") or shutil.which("google-chrome"),
        shutil.which("chromedriver"),
    )
    if program is None or driver is None:
        pytest.skip("no Chromium or Chrome with chromedriver here")
    options = webdriver.ChromeOptions()
    options.binary_location = program
    for flag in (
        *flags,
        *FLAGS,
        "--autoplay-policy=no-user-gesture-required",
        f"--host-resolver-rules={RULES}",
    ):
        options.add_argument(flag)
    options.set_capability("goog:loggingPrefs", {"browser": "ALL"})
    return webdriver.Chrome(options, Service(driver))


@pytest.fixture
def browser(chromium: webdriver.Chrome) -> Iterator[webdriver.Chrome]:
    """The browser, at a laptop's size; whatever it complained about fails the test."""
    chromium.get_log("browser")
    resize(chromium, 1280, 900)
    yield chromium
    chromium.get("about:blank")
    messages = [entry["message"] for entry in chromium.get_log("browser")]
    # On a busy machine a page's server may end before the browser fetched its icon.
    messages = [text for text in messages if "CONNECTION_REFUSED" not in text]
    assert messages == [], messages


def resize(browser: webdriver.Chrome, width: int, height: int) -> None:
    """Take the size of a window, or of a phone."""
    phone = width < 500
    metrics = {
        "width": width,
        "height": height,
        "deviceScaleFactor": 2 if phone else 1,
        "mobile": phone,
    }
    browser.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", metrics)


def text(browser: webdriver.Chrome, name: str) -> str:
    """What stands in the element of that id."""
    return browser.find_element(By.ID, name).text


def wait(
    browser: webdriver.Chrome, true: Callable[[], object], seconds: float = 10
) -> None:
    """Wait until it is true, and fail if that takes too long."""
    WebDriverWait(browser, seconds, poll_frequency=0.02).until(lambda _: true())


def stroke(
    browser: webdriver.Chrome, stone: int, *, lift: bool = True, step: int = 20
) -> None:
    """Press on a stone and move back and forth over it, 16 times for ``step`` ms."""
    stage = browser.find_element(By.ID, "stage")
    width, height = stage.rect["width"], stage.rect["height"]
    actions = ActionBuilder(browser, duration=step)
    for k in range(16):
        along = (0.0575 + 0.11 * stone + 0.03 * math.sin(0.5 * k)) / 0.555 - 0.5
        place = (0, int(height * along)) if height > width else (int(width * along), 0)
        actions.pointer_action.move_to(stage, *place)
        if k == 0:
            actions.pointer_action.pointer_down()
    if lift:
        actions.pointer_action.pointer_up()
    actions.perform()
