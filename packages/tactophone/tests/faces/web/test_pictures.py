"""The pictures of pages in the docs show the words that the pages have."""

import json
from pathlib import Path

import pytest
from selenium import webdriver

from benchmarks.page_words import WORDS_FILE, fixed_words
from tactophone.faces.web.server import Page
from tests.browser import resize, text, wait
from tests.faces.web.running import Run

pytestmark = pytest.mark.realtime

IMAGES = Path(__file__).parents[5] / "docs" / "images"

RENEW = "draw it again: python benchmarks/pictures.py docs/images"


def test_the_picture_of_the_dashboard_shows_its_words(
    browser: webdriver.Chrome, page: Page, run: Run
) -> None:
    resize(browser, 1280, 900)
    browser.get(page.url)
    wait(browser, lambda: text(browser, "life") == "live")
    wait(browser, lambda: "Buzz now" in fixed_words(browser))
    drawn = json.loads((IMAGES / WORDS_FILE).read_text("utf-8"))
    assert fixed_words(browser) == drawn["dashboard.png"], RENEW
