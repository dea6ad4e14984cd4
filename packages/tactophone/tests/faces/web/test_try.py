"""What the page *try* finds: a stroke counts by the word that stood for it, not by how
it began."""

import time
from dataclasses import replace

import pytest
from selenium import webdriver
from selenium.webdriver.common.by import By

from tactophone.core.types import Touch
from tactophone.faces.web.server import Page
from tests.browser import text, wait
from tests.faces.web.running import Run

pytestmark = pytest.mark.realtime


def stroke(run: Run, *parts: tuple[Touch, float]) -> None:
    """Render each of these touches for its seconds, then lift."""
    for touch, duration in (*parts, (Touch.NONE, 0.4)):
        run.touch = touch
        time.sleep(duration)


def test_one_surface_never_counts_as_both(
    browser: webdriver.Chrome, page: Page, run: Run
) -> None:
    run.state = replace(run.state, source="browser microphone")
    browser.get(page.url + "try")
    wait(browser, lambda: text(browser, "life") == "live")
    for _ in range(2):  # a mesh: every touch begins as smooth, and one wavers
        stroke(run, (Touch.SMOOTH, 0.3), (Touch.ROUGH, 0.9))
    stroke(run, (Touch.ROUGH, 0.7), (Touch.SMOOTH, 0.6))
    assert text(browser, "task").startswith("Stroke something smooth")
    stroke(run, (Touch.SMOOTH, 0.9))
    wait(browser, lambda: text(browser, "task").startswith("Now something rough"))
    stroke(run, (Touch.SMOOTH, 0.2), (Touch.ROUGH, 0.9))
    wait(browser, lambda: text(browser, "task").startswith("Both found"))


def test_a_missing_microphone_is_said_as_an_error(
    browser: webdriver.Chrome, page: Page, run: Run
) -> None:
    run.state = replace(run.state, source="browser")
    browser.get(page.url + "try")
    wait(browser, lambda: text(browser, "life") == "live")
    browser.find_element(By.ID, "listen").click()
    wait(browser, lambda: "has no microphone" in text(browser, "listen-state"))
    said = browser.find_element(By.ID, "listen-state")
    assert "wrong" in str(said.get_attribute("class"))
