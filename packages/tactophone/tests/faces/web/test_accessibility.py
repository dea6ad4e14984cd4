"""The pages of the operator and of `try`, by axe-core and by the keyboard alone."""

from dataclasses import replace
from typing import Any

import pytest
from selenium import webdriver
from selenium.webdriver.common.action_chains import ActionChains
from selenium.webdriver.common.by import By
from selenium.webdriver.common.keys import Keys

from tactophone.core.types import Touch
from tactophone.faces.web.server import Page
from tactophone.live.runtime.output_gate import EMERGENCY_STOP
from tactophone.live.telemetry.layout import Fault, FingerState
from tests.accessibility import (
    SIZES,
    needs_axe,
    outside,
    reached_by_tab,
    serious_faults,
)
from tests.browser import resize, text, wait
from tests.faces.web.running import Run

pytestmark = pytest.mark.realtime

PATHS = pytest.mark.parametrize("path", ["", "try"])


def open_page(browser: webdriver.Chrome, page: Page, path: str) -> None:
    browser.get(page.url + path)
    wait(browser, lambda: text(browser, "life") == "live")


@needs_axe
@PATHS
def test_axe_finds_nothing_serious(
    browser: webdriver.Chrome, page: Page, run: Run, path: str
) -> None:
    run.touch = Touch.ROUGH
    run.fail(
        Fault(
            "air_silent", "Air microphone silent for 3 s: using the one-channel model."
        )
    )
    open_page(browser, page, path)
    browser.find_element(By.ID, "feel").click()
    wait(
        browser,
        lambda: text(browser, "faults") and text(browser, "decision") == "rough",
    )
    assert serious_faults(browser) == []


MUTED = FingerState(
    armed=False, muted_because="muted on the page", ceiling=0.5, profile="paper"
)
STATES: dict[str, dict[str, Any]] = {
    "muted": {"fingers": (MUTED,)},
    "stopped": {"fingers": (replace(MUTED, muted_because=EMERGENCY_STOP),)},
    "robot": {"role": "robot", "output": "", "link": "connected to desk"},
    "replay": {"role": "replay", "output": "none", "link": "replay"},
    "calling": {"role": "robot", "output": "", "link": "calling"},
}


@needs_axe
@pytest.mark.parametrize("state", [*STATES, "no data", "ended"])
def test_axe_finds_nothing_serious_in_any_state_of_the_dashboard(
    browser: webdriver.Chrome, page: Page, run: Run, state: str
) -> None:
    open_page(browser, page, "")
    before = browser.find_element(By.ID, "state").get_attribute("data-state")
    run.silent = state == "no data"
    run.state = replace(run.state, **STATES.get(state, {}))
    if state == "ended":
        page.__exit__()
    wait(
        browser,
        lambda: (
            state in ("robot", "calling")
            or browser.find_element(By.ID, "state").get_attribute("data-state")
            != before
        ),
    )
    assert serious_faults(browser) == []
    if state == "ended":
        browser.get_log("browser")  # it seeks the server that has ended


@PATHS
@pytest.mark.parametrize("width", SIZES)
def test_nothing_is_wider_than_the_screen(
    browser: webdriver.Chrome, page: Page, path: str, width: int
) -> None:
    resize(browser, width, 844)
    open_page(browser, page, path)
    assert outside(browser) <= 0


@PATHS
def test_tab_reaches_every_control_and_shows_where_it_is(
    browser: webdriver.Chrome, page: Page, path: str
) -> None:
    open_page(browser, page, path)
    wait(browser, lambda: browser.find_element(By.ID, "threshold").is_enabled())
    count, reached = reached_by_tab(browser)
    assert len(reached) == count
    assert [name for name, seen in reached.items() if not seen] == []


@PATHS
def test_keys_alone_begin_and_end_to_feel(
    browser: webdriver.Chrome, page: Page, path: str
) -> None:
    open_page(browser, page, path)
    button = browser.find_element(By.ID, "feel")
    browser.execute_script("arguments[0].focus()", button)
    for key, pressed in ((Keys.ENTER, "true"), (Keys.SPACE, "false")):
        ActionChains(browser).send_keys(key).perform()
        assert button.get_attribute("aria-pressed") == pressed
        # What the button starts is loaded then: a page left in the middle of it would
        # complain.
        wait(
            browser,
            lambda: (
                (text(browser, "feel-way") != "")
                is (button.get_attribute("aria-pressed") == "true")
            ),
        )
