"""The operator's page in a real browser."""

import itertools
import time
from dataclasses import replace

import pytest
from selenium import webdriver
from selenium.webdriver.common.by import By
from selenium.webdriver.common.keys import Keys

from tactophone.core.types import Touch
from tactophone.faces.web.server import Page
from tactophone.live.telemetry.layout import Fault
from tests.browser import resize, text, wait
from tests.faces.web.running import Run

pytestmark = pytest.mark.realtime


def open_page(browser: webdriver.Chrome, page: Page) -> None:
    browser.get(page.url)
    wait(browser, lambda: text(browser, "life") == "live")


def view(browser: webdriver.Chrome, name: str) -> None:
    browser.find_element(By.CSS_SELECTOR, f"#views [value={name}]").click()


def test_it_shows_a_rough_stroke_as_rough_within_a_second(
    browser: webdriver.Chrome, page: Page, run: Run
) -> None:
    open_page(browser, page)
    delays = []
    for _ in range(3):
        run.touch = Touch.NONE
        wait(browser, lambda: text(browser, "decision") == "no contact")
        run.touch, begin = Touch.ROUGH, time.monotonic()
        wait(browser, lambda: text(browser, "decision") == "rough")
        delays.append(time.monotonic() - begin)
    assert sorted(delays)[1] < 1.0
    wait(browser, lambda: text(browser, "frequency") == "60\u202fHz")
    assert text(browser, "amplitude") == "50\u202f%"


def test_mute_stays_until_somebody_arms(
    browser: webdriver.Chrome, page: Page, run: Run
) -> None:
    run.touch = Touch.ROUGH
    open_page(browser, page)
    button = browser.find_element(By.ID, "mute")
    wait(browser, lambda: button.text == "Mute")
    button.click()
    wait(browser, lambda: text(browser, "cause") == "Muted on the page.")
    assert not run.state.armed
    browser.refresh()
    wait(browser, lambda: text(browser, "cause") == "Muted on the page.")
    # The key mutes and never arms.
    browser.find_element(By.TAG_NAME, "body").send_keys("m")
    time.sleep(0.3)
    assert not run.state.armed
    wait(browser, lambda: text(browser, "mute") == "Resume")
    browser.find_element(By.ID, "mute").click()
    wait(browser, lambda: text(browser, "life") == "live")
    browser.find_element(By.TAG_NAME, "body").send_keys("m")
    wait(browser, lambda: not run.state.armed)


def test_levels_profile_and_threshold_are_set_by_the_keyboard(
    browser: webdriver.Chrome, page: Page, run: Run
) -> None:
    open_page(browser, page)
    wait(
        browser,
        lambda: browser.find_element(By.ID, "ceiling").get_attribute("max") == "0.5",
    )
    browser.find_element(By.ID, "level").send_keys(Keys.ARROW_LEFT * 3)
    wait(browser, lambda: run.finger.output_level == pytest.approx(0.97))
    browser.find_element(By.ID, "ceiling").send_keys(Keys.ARROW_LEFT * 5)
    wait(browser, lambda: run.finger.ceiling == pytest.approx(0.45))
    wait(
        browser,
        lambda: browser.find_element(By.ID, "ceiling").get_attribute("max") == "0.45",
    )
    view(browser, "setup")
    browser.find_element(By.ID, "threshold").send_keys(Keys.ARROW_RIGHT * 2)
    wait(browser, lambda: run.finger.threshold_dbfs == pytest.approx(-51.0))
    browser.find_element(By.ID, "profile").send_keys("plain")
    wait(browser, lambda: run.finger.profile == "plain")


def test_enter_that_is_held_on_buzz_now_buzzes_once(
    browser: webdriver.Chrome, page: Page, run: Run
) -> None:
    """It vibrated at the ceiling for as long as a book lay on the key."""
    open_page(browser, page)
    button = browser.find_element(By.CSS_SELECTOR, "#buzz-part .buzz-now")
    wait(browser, button.is_enabled)
    browser.execute_script("arguments[0].focus()", button)
    enter = {"key": "Enter", "code": "Enter", "windowsVirtualKeyCode": 13}
    down = {**enter, "type": "keyDown", "text": "\r"}
    for repeated in [False] + [True] * 10:
        browser.execute_cdp_cmd(
            "Input.dispatchKeyEvent", {**down, "autoRepeat": repeated}
        )
        time.sleep(0.03)
    browser.execute_cdp_cmd("Input.dispatchKeyEvent", {**enter, "type": "keyUp"})
    wait(browser, lambda: run.buzzes)
    time.sleep(0.3)
    assert run.buzzes == 1


def test_buzz_now_asks_the_run_and_cannot_while_muted_or_at_level_0(
    browser: webdriver.Chrome, page: Page, run: Run
) -> None:
    open_page(browser, page)
    button = browser.find_element(By.CSS_SELECTOR, "#buzz-part .buzz-now")
    wait(browser, button.is_enabled)
    assert "50\u202f% of full drive" in text(browser, "buzz-hint")
    button.click()
    wait(browser, lambda: run.buzzes == 1)
    for action in ("mute", "stop"):
        browser.find_element(By.ID, action).click()
        wait(browser, lambda: not button.is_enabled())
    assert "muted or stopped" in text(browser, "buzz-hint")
    run.state = replace(
        run.state,
        fingers=(replace(run.finger, armed=True, muted_because="", output_level=0.0),),
    )
    wait(browser, lambda: "0\u202f% of full drive" in text(browser, "buzz-hint"))
    assert not button.is_enabled()
    assert run.buzzes == 1


def test_what_cannot_buzz_has_no_button(
    browser: webdriver.Chrome, page: Page, run: Run
) -> None:
    run.state = replace(run.state, fingers=(replace(run.finger, can_buzz=False),))
    open_page(browser, page)
    wait(browser, lambda: text(browser, "run"))
    assert not browser.find_element(By.ID, "buzz-part").is_displayed()


def test_the_spectrogram_is_dark_where_a_stroke_is_loud(
    browser: webdriver.Chrome, page: Page, run: Run
) -> None:
    open_page(browser, page)
    view(browser, "engineer")
    time.sleep(1)
    run.touch = Touch.ROUGH
    time.sleep(1)

    def shade(share: float) -> int:
        """The sum of red in a column of the picture, at a share of its width."""
        found = browser.execute_script(
            "const canvas = document.querySelector('#spectrogram canvas');"
            "const x = Math.round(canvas.width * arguments[0]);"
            "const copy = new OffscreenCanvas(canvas.width, canvas.height);"
            "const paint = copy.getContext('2d', {willReadFrequently: true});"
            "paint.drawImage(canvas, 0, 0);"
            "const { data } = paint.getImageData(x, 20, 1, canvas.height - 60);"
            "return data.filter((_, k) => k % 4 === 0).reduce((a, b) => a + b, 0);",
            share,
        )
        assert isinstance(found, int)
        return found

    wait(browser, lambda: shade(0.93) < 0.8 * shade(0.7))


def test_before_a_call_each_end_says_what_to_check(
    browser: webdriver.Chrome, page: Page, run: Run
) -> None:
    run.state = replace(run.state, role="operator", link="listening at port 48470")
    open_page(browser, page)
    wait(browser, lambda: "press Buzz now" in text(browser, "check"))
    browser.find_element(By.ID, "check-buzz").click()
    wait(browser, lambda: run.buzzes == 1)
    run.state = replace(run.state, role="robot", link="calling")
    wait(browser, lambda: "stroke the finger" in text(browser, "check"))
    run.touch = Touch.ROUGH
    wait(browser, lambda: text(browser, "check").count("hears the finger") == 2)
    run.state = replace(run.state, link="connected to desk")
    wait(browser, lambda: text(browser, "check") == "")


def test_a_fault_is_shown_and_then_its_end(
    browser: webdriver.Chrome, page: Page, run: Run
) -> None:
    open_page(browser, page)
    run.fail(
        Fault(
            "air_silent", "Air microphone silent for 3 s: using the one-channel model."
        )
    )
    wait(browser, lambda: "one-channel" in text(browser, "faults"))
    run.fail()
    wait(browser, lambda: text(browser, "faults").startswith("Over: Air microphone"))
    run.fail(Fault("air_silent", "Air microphone silent for 5 s."))
    wait(browser, lambda: text(browser, "faults") == "Air microphone silent for 5 s.")


def test_the_budget_and_the_link_are_shown_as_numbers(
    browser: webdriver.Chrome, page: Page, run: Run
) -> None:
    run.telemetry.count("packets_lost", 71)
    run.telemetry.gauge("latency_detect", 0.0006)
    run.telemetry.gauge("latency_total", 0.0081)
    open_page(browser, page)
    wait(browser, lambda: "8.1\u202fms from touch" in text(browser, "health"))
    assert "71 of" in text(browser, "health")
    view(browser, "engineer")
    wait(browser, lambda: "8.1\u202fms" in text(browser, "total"))
    assert "71" in text(browser, "link")
    assert "detect 0.6" in str(
        browser.find_element(By.ID, "stack").get_attribute("aria-label")
    )


@pytest.mark.parametrize("width", [390, 1280])
@pytest.mark.parametrize("theme", ["light", "dark"])
def test_it_fits_a_phone_and_a_laptop_in_both_themes(
    browser: webdriver.Chrome, page: Page, width: int, theme: str
) -> None:
    resize(browser, width, 844)
    preferred = [{"name": "prefers-color-scheme", "value": theme}]
    browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": preferred})
    open_page(browser, page)
    root = browser.find_element(By.TAG_NAME, "html")
    assert root.get_attribute("data-theme") == theme
    assert (
        browser.execute_script("return document.documentElement.scrollWidth") <= width
    )
    browser.find_element(By.ID, "theme").click()
    assert root.get_attribute("data-theme") != theme
    browser.find_element(By.ID, "theme").click()


def test_everything_that_can_be_used_has_a_name(
    browser: webdriver.Chrome, page: Page
) -> None:
    open_page(browser, page)
    found = set()
    for name in ("operator", "engineer", "setup"):
        view(browser, name)
        nodes = browser.find_elements(
            By.CSS_SELECTOR, "button, input, select, [role=img], [role=group], section"
        )
        shown = [node for node in nodes if node.is_displayed()]
        assert [
            node.get_attribute("outerHTML")[:80]
            for node in shown
            if not node.accessible_name
        ] == []
        found |= set(shown)
    assert len(found) > 20


def box(browser: webdriver.Chrome, selector: str) -> dict[str, float]:
    script = "const box = document.querySelector(arguments[0]).getBoundingClientRect();"
    found = browser.execute_script(
        script + "return {top: box.top, bottom: box.bottom, height: box.height};",
        selector,
    )
    assert isinstance(found, dict)
    return found


def test_a_laptop_shows_fingertip_timeline_and_controls_without_scrolling(
    browser: webdriver.Chrome, page: Page
) -> None:
    resize(browser, 1280, 800)
    open_page(browser, page)
    for selector in ("#stop", "#hero", ".touch", "#feel", "#level", "#ceiling"):
        assert (
            0 <= box(browser, selector)["top"] < box(browser, selector)["bottom"] <= 800
        ), selector


def test_a_phone_shows_all_but_the_log_without_scrolling_and_controls_fit_a_thumb(
    browser: webdriver.Chrome, page: Page
) -> None:
    resize(browser, 390, 844)
    open_page(browser, page)
    for selector in ("#stop", "#decision", "#hero", ".touch"):
        assert (
            0 <= box(browser, selector)["top"] < box(browser, selector)["bottom"] <= 844
        ), selector
    controls = browser.find_elements(By.CSS_SELECTOR, "button, input, select")
    small = [
        node.get_attribute("id") for node in controls if 0 < node.size["height"] < 44
    ]
    assert small == []


def test_the_timeline_reads_out_values_and_pauses(
    browser: webdriver.Chrome, page: Page, run: Run
) -> None:
    run.touch = Touch.ROUGH
    open_page(browser, page)
    wait(browser, lambda: text(browser, "decision") == "rough")
    time.sleep(1)
    body, plot = (
        browser.find_element(By.TAG_NAME, "body"),
        browser.find_element(By.CSS_SELECTOR, ".touch"),
    )
    body.send_keys("p")
    plot.send_keys(Keys.ARROW_LEFT * 3)
    words = browser.find_element(By.CSS_SELECTOR, ".readout")
    wait(
        browser,
        lambda: (
            "ago: rough · roughness 0.92 · 60\u202fHz at 50\u202f% of full drive"
            in words.text
        ),
    )
    assert "label: rough" in words.text
    paused = words.text
    run.touch = Touch.NONE
    time.sleep(1)
    assert words.text == paused


def test_it_draws_at_the_screen_s_pace(browser: webdriver.Chrome, page: Page) -> None:
    open_page(browser, page)
    drawn = browser.execute_async_script(
        "const done = arguments[0], times = []; const note = (t) => { times.push(t);"
        "times.length < 61 ? requestAnimationFrame(note) : done(times); }; "
        "requestAnimationFrame(note);"
    )
    steps = sorted(later - earlier for earlier, later in itertools.pairwise(drawn))
    # In ms: half a screen's pace on a busy machine; benchmarks measure it well.
    assert steps[len(steps) // 2] < 34
