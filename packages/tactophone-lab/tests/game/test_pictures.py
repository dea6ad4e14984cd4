"""The picture of the stone box in the docs shows the words that its page has."""

import json
from multiprocessing import Pipe
from pathlib import Path

import pytest
from selenium import webdriver

from benchmarks.page_words import WORDS_FILE, fixed_words
from tactophone.core.types import Touch
from tactophone_lab.game.game_page import serve_game
from tactophone_lab.game.stone_box import GameSettings
from tests.browser import browser, chromium, text, wait
from tests.faces.web.running import Run

__all__ = ["browser", "chromium"]

pytestmark = pytest.mark.realtime

IMAGES = Path(__file__).parents[4] / "docs" / "images"


def test_the_picture_of_the_stone_box_shows_its_words(
    browser: webdriver.Chrome, tmp_path: Path
) -> None:
    _, finger = Pipe(duplex=False)
    stones = [(Touch.ROUGH,) * 5]
    with Run("test-box-picture") as run:
        box = GameSettings(
            run.telemetry.name, stones, 7, finger, tmp_path / "results.jsonl"
        )
        with serve_game(box) as page:
            browser.get(page.url)
            wait(browser, lambda: text(browser, "life") == "ready")
            browser.execute_script("document.body.dataset.screen = 'reveal'")
            shown = fixed_words(browser)
            browser.get("about:blank")
    drawn = json.loads((IMAGES / WORDS_FILE).read_text("utf-8"))
    assert shown == drawn["stone-box.png"], (
        "draw it again: python benchmarks/pictures.py docs/images"
    )
