"""The stone box in a real browser, over a run that detects every touch at once."""

import json
import os
import time
from collections.abc import Iterator
from dataclasses import replace
from multiprocessing import Pipe
from pathlib import Path

import pytest
from selenium import webdriver
from selenium.webdriver.common.action_chains import ActionChains
from selenium.webdriver.common.actions.action_builder import ActionBuilder
from selenium.webdriver.common.by import By
from selenium.webdriver.common.keys import Keys

from tactophone.core.types import Touch
from tactophone.faces.web.server import Page
from tactophone_lab.game.game_page import serve_game
from tactophone_lab.game.stone_box import GameSettings
from tests.accessibility import needs_axe, outside, reached_by_tab, serious_faults
from tests.browser import resize, stroke, text, wait
from tests.faces.web.running import Run

pytestmark = pytest.mark.realtime

ORDER = (Touch.SMOOTH, Touch.ROUGH, Touch.SMOOTH, Touch.SMOOTH, Touch.ROUGH)


@pytest.fixture
def results(tmp_path: Path) -> Path:
    return tmp_path / "results.jsonl"


@pytest.fixture
def led() -> Iterator[tuple[Run, GameSettings]]:
    inbox, finger = Pipe(duplex=False)
    with Run(f"test-box-{os.getpid()}", inbox) as run:
        yield (
            run,
            GameSettings(run.telemetry.name, [ORDER, ORDER[::-1]], 7, finger, Path()),
        )


@pytest.fixture
def box(led: tuple[Run, GameSettings], results: Path) -> Iterator[Page]:
    _, settings = led
    with serve_game(replace(settings, results=results)) as page:
        yield page


def begin(browser: webdriver.Chrome, box: Page, *, trainer: bool = False) -> None:
    browser.get(box.url)
    wait(browser, lambda: browser.find_element(By.ID, "begin").is_enabled())
    if trainer:
        browser.find_element(By.ID, "trainer").click()
    browser.find_element(By.ID, "begin").click()


@pytest.mark.parametrize("width", [390, 1280])
def test_a_round_is_played_to_its_end_by_moving_the_pointer(
    browser: webdriver.Chrome, box: Page, results: Path, width: int
) -> None:
    resize(browser, width, 844)
    begin(browser, box)
    for stone in range(5):
        stroke(browser, stone)
        time.sleep(0.2)
    marks = browser.find_elements(By.CSS_SELECTOR, "#marks button")
    done = browser.find_element(By.ID, "done")
    marks[1].click()
    assert not done.is_enabled()
    marks[4].click()
    done.click()
    wait(browser, lambda: text(browser, "verdict") == "Both are right")
    (line,) = results.read_text().splitlines()
    result = json.loads(line)
    assert (result["correct"], result["choices"], result["seed"]) == (2, [1, 4], 7)
    assert all(count >= 1 for count in result["strokes"])
    assert 0 < result["round_trip"] < 1
    assert result["false_bumps"] == result["dips"] == 0
    browser.find_element(By.CSS_SELECTOR, "#reveal summary").click()
    wait(browser, lambda: "false bumps" in text(browser, "score"))
    assert "false bumps: 0, dips: 0" in text(browser, "round")
    stones = [
        node.text for node in browser.find_elements(By.CSS_SELECTOR, "#lifted .slot")
    ]
    assert stones == ["smooth", "rough ✓", "smooth", "smooth", "rough ✓"]
    assert (
        browser.execute_script("return document.documentElement.scrollWidth") <= width
    )


def test_a_round_that_cannot_be_saved_is_shown_all_the_same(
    browser: webdriver.Chrome, box: Page, results: Path
) -> None:
    begin(browser, box)
    results.mkdir()  # as if the disk were full
    stroke(browser, 1)
    browser.find_element(By.TAG_NAME, "body").send_keys("12")
    browser.find_element(By.ID, "done").click()
    wait(browser, lambda: text(browser, "verdict") == "One of two is right")
    assert text(browser, "kept") == f"Not saved in {results}: Is a directory"


def test_a_vibration_can_be_felt_before_the_round_and_stop_ends_it(
    browser: webdriver.Chrome, box: Page, led: tuple[Run, GameSettings]
) -> None:
    browser.get(box.url)
    wait(browser, lambda: browser.find_element(By.ID, "test").is_enabled())
    browser.execute_script(
        "window.played = []; const post = MessagePort.prototype.postMessage;"
        "MessagePort.prototype.postMessage = function (data, ...rest) {"
        "if (data) window.played.push(Math.max(...data)); return post.call(this, "
        "data, ...rest); };"
    )
    browser.find_element(By.ID, "test").click()
    wait(browser, lambda: "buzz of half a second" in text(browser, "test-state"))
    played = [
        peak for peak in browser.execute_script("return window.played") if peak > 0
    ]
    assert len(played) == 12
    assert max(played) == pytest.approx(0.25, abs=0.01)  # half the ceiling
    browser.find_element(By.ID, "stop").click()
    wait(browser, lambda: not browser.find_element(By.ID, "test").is_enabled())
    wait(browser, lambda: not browser.find_element(By.ID, "begin").is_enabled())
    assert not led[0].state.armed


def test_a_third_mark_is_answered(browser: webdriver.Chrome, box: Page) -> None:
    begin(browser, box)
    marks = browser.find_elements(By.CSS_SELECTOR, "#marks button")
    for stone in (0, 2, 4):
        marks[stone].click()
    assert "take one of the marks off" in text(browser, "marked")
    assert [mark.get_attribute("aria-pressed") for mark in marks] == [
        "true",
        "false",
        "true",
        "false",
        "false",
    ]
    marks[0].click()
    assert text(browser, "marked") == "Mark one stone more to lift the curtain."


def test_the_result_is_kept_as_a_picture(browser: webdriver.Chrome, box: Page) -> None:
    begin(browser, box)
    finish(browser)
    browser.execute_script(
        "HTMLAnchorElement.prototype.click = function () {window.saved = "
        "[this.download, this.href.slice(0, 5)]; };"
    )
    browser.find_element(By.ID, "card").click()
    wait(browser, lambda: browser.execute_script("return window.saved"))
    assert browser.execute_script("return window.saved") == ["stone-box-7.png", "blob:"]


def test_nothing_reveals_a_stone_before_the_curtain_is_lifted(
    browser: webdriver.Chrome, box: Page
) -> None:
    begin(browser, box)
    looks = []
    for stone in range(5):
        stroke(browser, stone, lift=False)
        time.sleep(0.3)
        looks.append(text(browser, "message"))
        stroke(browser, stone)
    assert looks == [""] * 5
    slots = browser.find_elements(By.CSS_SELECTOR, "#stage .slot")
    assert {(slot.get_attribute("class"), slot.size["width"]) for slot in slots} == {
        ("slot", slots[0].size["width"])
    }
    assert "rough" not in browser.execute_script(
        "return document.querySelector('#stage').outerHTML"
    )


def test_the_trainer_shows_the_detected_touch_and_the_round_does_not_count(
    browser: webdriver.Chrome, box: Page, results: Path
) -> None:
    begin(browser, box, trainer=True)
    stroke(browser, 1, lift=False)
    wait(
        browser,
        lambda: text(browser, "message") == "rough under the finger, rough detected",
    )
    stroke(browser, 0, lift=False)
    wait(
        browser,
        lambda: text(browser, "message") == "smooth under the finger, smooth detected",
    )
    body = browser.find_element(By.TAG_NAME, "body")
    body.send_keys("12")
    browser.find_element(By.ID, "done").click()
    wait(browser, lambda: text(browser, "verdict") == "One of two is right")
    assert json.loads(results.read_text())["trainer"] is True
    assert "not scored" in text(browser, "took")
    assert "So far" not in text(browser, "took")


def test_a_round_is_played_by_keys_alone(
    browser: webdriver.Chrome, box: Page, led: tuple[Run, GameSettings]
) -> None:
    begin(browser, box)
    stage = browser.find_element(By.ID, "stage")
    stage.send_keys(Keys.ARROW_LEFT * 27, " ")
    wait(browser, lambda: led[0].touch is Touch.ROUGH)
    stage.send_keys(" ")
    wait(browser, lambda: led[0].touch is Touch.NONE)
    stage.send_keys("2", "5")
    assert browser.find_element(By.ID, "done").is_enabled()


def test_a_second_window_takes_the_place_until_it_is_closed(
    browser: webdriver.Chrome, box: Page
) -> None:
    begin(browser, box)
    first = browser.current_window_handle
    browser.switch_to.new_window("window")
    browser.get(box.url)
    wait(browser, lambda: text(browser, "life") == "ready")
    second = browser.current_window_handle
    browser.switch_to.window(first)
    wait(browser, lambda: text(browser, "life") == "opened in another window")
    time.sleep(1.5)  # longer than a lost page waits before it comes back
    browser.switch_to.window(second)
    assert text(browser, "life") == "ready"
    browser.close()
    browser.switch_to.window(first)
    wait(browser, lambda: text(browser, "life") == "ready")


def test_leaving_the_page_lifts_the_finger(
    browser: webdriver.Chrome, box: Page, led: tuple[Run, GameSettings]
) -> None:
    begin(browser, box)
    stroke(browser, 4, lift=False)
    wait(browser, lambda: led[0].touch is Touch.ROUGH)
    browser.get("about:blank")
    wait(browser, lambda: led[0].touch is Touch.NONE)
    ActionBuilder(browser).clear_actions()


def finish(browser: webdriver.Chrome) -> None:
    """Stroke a rough stone, mark two by keys, and lift the curtain."""
    stroke(browser, 1)
    browser.find_element(By.ID, "stage").send_keys("2", "5", Keys.TAB)
    browser.execute_script("document.querySelector('#done').focus()")
    ActionChains(browser).send_keys(Keys.ENTER).perform()
    wait(browser, lambda: text(browser, "verdict") == "Both are right")


@needs_axe
def test_axe_finds_nothing_serious_on_any_screen(
    browser: webdriver.Chrome, box: Page
) -> None:
    browser.get(box.url)
    wait(browser, lambda: browser.find_element(By.ID, "begin").is_enabled())
    faults = {"door": serious_faults(browser)}
    begin(browser, box, trainer=True)
    stroke(browser, 1, lift=False)
    faults["play"] = serious_faults(browser)
    finish(browser)
    faults["reveal"] = serious_faults(browser)
    assert faults == {"door": [], "play": [], "reveal": []}


def test_tab_reaches_every_control_of_every_screen(
    browser: webdriver.Chrome, box: Page
) -> None:
    browser.get(box.url)
    wait(browser, lambda: browser.find_element(By.ID, "begin").is_enabled())
    screens = [reached_by_tab(browser)]
    browser.execute_script("document.querySelector('#begin').focus()")
    ActionChains(browser).send_keys(Keys.ENTER).perform()
    screens.append(reached_by_tab(browser))
    finish(browser)
    screens.append(reached_by_tab(browser))
    assert [len(reached) for _, reached in screens] == [count for count, _ in screens]
    assert [
        name for _, reached in screens for name, seen in reached.items() if not seen
    ] == []
    assert outside(browser) <= 0


def test_a_phone_may_be_turned_after_the_curtain_is_lifted(
    browser: webdriver.Chrome, box: Page
) -> None:
    begin(browser, box)
    finish(browser)
    resize(browser, 390, 844)
    stage = browser.find_element(By.ID, "lifted")
    wait(browser, lambda: stage.size["height"] > stage.size["width"])
    slots = "#lifted .slot"
    wait(
        browser,
        lambda: (
            browser.find_element(By.CSS_SELECTOR, slots).size["width"]
            > 0.7 * stage.size["width"]
        ),
    )
    assert outside(browser) <= 0
