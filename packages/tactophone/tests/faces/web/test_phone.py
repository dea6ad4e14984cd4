"""The pages at a phone's size, and the code that leads a phone to them."""

import ssl
import urllib.request
from urllib.error import HTTPError

import pytest
from selenium import webdriver
from selenium.webdriver.common.by import By

from tactophone.core.types import Touch
from tactophone.faces.web.server import Page, watch
from tests.browser import resize, text, wait
from tests.faces.web.running import Run

pytestmark = pytest.mark.realtime

FOLD = 844
"""Pixels of a phone's screen, 390 wide."""


def bottom(browser: webdriver.Chrome, name: str) -> float:
    """Where an element ends, in pixels below the top of the screen."""
    return float(
        browser.execute_script(
            "const shown = document.getElementById(arguments[0]);"
            "return shown.getBoundingClientRect().bottom",
            name,
        )
    )


def test_the_next_step_stands_above_the_fold(
    browser: webdriver.Chrome, page: Page
) -> None:
    resize(browser, 390, FOLD)
    browser.get(page.url)
    wait(browser, lambda: text(browser, "life") == "live")
    assert bottom(browser, "feel") <= FOLD
    assert bottom(browser, "hero") <= FOLD


def test_use_this_microphone_stands_above_the_fold_until_sound_comes(
    browser: webdriver.Chrome,
) -> None:
    resize(browser, 390, FOLD)
    with watch("test-not-yet-begun") as page:
        browser.get(f"{page.url}try")
        wait(browser, lambda: text(browser, "life") == "waiting")
        assert bottom(browser, "listen") <= FOLD
        browser.get("about:blank")


def test_a_page_for_this_machine_alone_says_how_a_phone_gets_in(
    browser: webdriver.Chrome, page: Page
) -> None:
    browser.get(page.url)
    browser.find_element(By.CSS_SELECTOR, "#phone summary").click()
    wait(browser, lambda: "--lan" in text(browser, "phone"))
    assert not browser.find_elements(By.CSS_SELECTOR, "#phone img")


def test_a_page_for_the_network_shows_its_address_as_a_code(
    browser: webdriver.Chrome, run: Run
) -> None:
    pytest.importorskip("segno")
    with watch(run.telemetry.name, "0.0.0.0:0") as page:
        local = f"http://127.0.0.1:{page.access.port}/{page.access.token}/"
        browser.get(f"{local}try")
        browser.find_element(By.CSS_SELECTOR, "#phone summary").click()
        wait(browser, lambda: browser.find_elements(By.CSS_SELECTOR, "#phone img"))
        image = browser.find_element(By.CSS_SELECTOR, "#phone img")
        wait(browser, lambda: image.get_property("naturalWidth"))
        with pytest.raises(HTTPError, match="403"):
            urllib.request.urlopen(
                f"http://127.0.0.1:{page.access.port}/wrong/qr.svg",
                context=ssl.create_default_context(),
            )
        browser.get("about:blank")


def test_smooth_tints_the_fingertip_though_it_is_faint(
    browser: webdriver.Chrome, page: Page, run: Run
) -> None:
    run.touch = Touch.SMOOTH
    browser.get(page.url)
    wait(browser, lambda: text(browser, "decision") == "smooth")
    wait(
        browser,
        lambda: (
            float(
                browser.find_element(By.CSS_SELECTOR, ".glow").value_of_css_property(
                    "opacity"
                )
            )
            > 0.6
        ),
    )


def test_without_data_no_word_stands_as_if_it_were_new(
    browser: webdriver.Chrome, page: Page, run: Run
) -> None:
    run.touch = Touch.SMOOTH
    browser.get(page.url)
    wait(browser, lambda: text(browser, "decision") == "smooth")
    run.silent = True
    wait(browser, lambda: text(browser, "life").startswith("no data"))
    wait(browser, lambda: text(browser, "decision") == "–")
    assert text(browser, "amplitude") == "–"
    run.silent = False
    wait(browser, lambda: text(browser, "decision") == "smooth")
