"""What the state bar shows in each state of a run, on every page that can vibrate."""

import time
from collections.abc import Iterator
from dataclasses import replace
from multiprocessing import Pipe
from pathlib import Path

import pytest
from selenium import webdriver
from selenium.webdriver.common.action_chains import ActionChains
from selenium.webdriver.common.by import By
from selenium.webdriver.common.keys import Keys

from tactophone.core.types import Touch
from tactophone.faces.web.server import Page, watch
from tactophone.live.runtime.output_gate import EMERGENCY_STOP
from tactophone.live.telemetry.watcher import Watcher
from tactophone_lab.game.game_page import serve_game
from tactophone_lab.game.stone_box import GameSettings
from tests.browser import resize, text, wait
from tests.faces.web.running import Run

pytestmark = pytest.mark.realtime

PAGES = {"dashboard": "", "try": "try", "play": ""}
SEEN = """
const box = arguments[0].getBoundingClientRect();
const [x, y] = [box.left + box.width / 2, box.top + box.height / 2];
const over = document.elementFromPoint(x, y);
return box.width > 0 && arguments[0].contains(over);
"""
COLOUR = (
    "const state = document.querySelector('#state');"
    "return getComputedStyle(state).getPropertyValue('--state')"
)


@pytest.fixture(params=PAGES)
def shown(
    request: pytest.FixtureRequest, browser: webdriver.Chrome, run: Run, tmp_path: Path
) -> Iterator[Page]:
    """Each page that can vibrate, open, over a run that vibrates."""
    _, finger = Pipe(duplex=False)
    run.touch = Touch.ROUGH
    box = GameSettings(
        run.telemetry.name, [(Touch.ROUGH,) * 5], 7, finger, tmp_path / "results.jsonl"
    )
    with (
        serve_game(box)
        if request.param == "play"
        else watch(run.telemetry.name) as page
    ):
        browser.get(page.url + PAGES[request.param])
        wait(browser, lambda: text(browser, "life") in ("live", "ready"))
        yield page


def seen(browser: webdriver.Chrome) -> list[str]:
    """The ids of what of the state bar and its cover a person sees, and nothing
    hides."""
    names = ("life", "cause", "mute", "stop", "cover")
    return [
        name
        for name in names
        if browser.execute_script(SEEN, browser.find_element(By.ID, name))
    ]


def can_press(browser: webdriver.Chrome, name: str) -> bool:
    return browser.find_element(By.ID, name).is_enabled()


@pytest.mark.parametrize("width", [390, 1280])
def test_the_bar_is_in_view_in_every_state_with_colour_cause_and_buttons(
    browser: webdriver.Chrome, shown: Page, run: Run, width: int
) -> None:
    resize(browser, width, 844)
    browser.execute_script("scrollTo(0, 1e6)")
    assert seen(browser) == ["life", "cause", "mute", "stop"]
    assert browser.find_element(By.ID, "state").size["width"] == browser.execute_script(
        "return document.body.clientWidth"
    )
    colours = {browser.execute_script(COLOUR)}

    browser.find_element(By.ID, "mute").click()
    wait(browser, lambda: text(browser, "life") == "muted")
    assert text(browser, "cause") == "Muted on the page."
    assert seen(browser) == ["life", "cause", "mute", "stop"]
    wait(browser, lambda: text(browser, "mute") == "Resume")
    colours.add(browser.execute_script(COLOUR))
    browser.find_element(By.ID, "mute").click()
    wait(browser, lambda: run.state.armed)

    browser.find_element(By.ID, "stop").click()
    wait(browser, lambda: text(browser, "life") == "stopped")
    assert run.finger.muted_because == EMERGENCY_STOP
    assert "find the cause" in text(browser, "cause")
    assert (seen(browser), text(browser, "stop")) == (
        ["life", "cause", "stop"],
        "Hold to resume",
    )
    colours.add(browser.execute_script(COLOUR))
    browser.find_element(By.ID, "stop").click()  # a press in passing releases nothing
    browser.find_element(By.TAG_NAME, "body").send_keys("m", "a", " ")
    time.sleep(1.2)
    assert not run.state.armed
    run.silent = True  # which must not offer to arm by one press
    time.sleep(1)
    assert (text(browser, "life"), seen(browser)) == (
        "stopped",
        ["life", "cause", "stop"],
    )
    run.silent = False
    ActionChains(browser).click_and_hold(browser.find_element(By.ID, "stop")).pause(
        2
    ).release().perform()
    wait(browser, lambda: run.state.armed)

    run.silent = True
    wait(browser, lambda: text(browser, "life").startswith("no data"))
    wait(browser, lambda: float(text(browser, "life").split()[2]) >= 1)
    assert "No sound arrives" in text(browser, "cause")
    assert seen(browser) == ["life", "cause", "mute", "stop"]
    assert can_press(browser, "stop")
    colours.add(browser.execute_script(COLOUR))
    run.silent = False
    wait(browser, lambda: text(browser, "life") in ("live", "ready"))

    shown.__exit__()
    wait(browser, lambda: text(browser, "life") == "ended")
    assert "cover" in seen(browser)
    assert text(browser, "command").startswith("tactophone")
    assert not can_press(browser, "stop")
    assert not can_press(browser, "mute")
    colours.add(browser.execute_script(COLOUR))
    assert len(colours) == 5
    browser.get_log("browser")  # it seeks the server that has ended


def test_a_page_whose_server_dies_does_not_say_that_the_run_has_ended(
    browser: webdriver.Chrome, shown: Page, run: Run
) -> None:
    """It said that nothing vibrated any more, while the run went on."""
    shown._child.kill()
    wait(browser, lambda: text(browser, "life") == "disconnected")
    assert run.state.armed
    assert "may go on, and vibrate" in text(browser, "cover")
    assert "has ended" not in text(browser, "cover")
    browser.get_log("browser")  # it seeks the server that has died


def test_values_grey_within_half_a_second_and_the_bar_says_how_long(
    browser: webdriver.Chrome, page: Page, run: Run
) -> None:
    browser.get(page.url)
    wait(browser, lambda: text(browser, "life") == "live")
    stale = "return document.body.dataset.stale === 'true'"
    assert not browser.execute_script(stale)
    run.silent = True
    begin = time.monotonic()
    wait(browser, lambda: browser.execute_script(stale))
    # It takes 0.5 s of the page's own clock, and the way to it on a busy machine.
    assert time.monotonic() - begin < 0.9


def test_a_run_without_a_heartbeat_has_no_data_and_takes_no_arming(
    browser: webdriver.Chrome, page: Page, run: Run
) -> None:
    browser.get(page.url)
    wait(browser, lambda: text(browser, "life") == "live")
    run.pause()
    wait(browser, lambda: "no sign of life" in text(browser, "cause"))
    assert text(browser, "life").startswith("no data")
    assert not can_press(browser, "mute")


@pytest.mark.parametrize("key", [Keys.SPACE, Keys.ESCAPE])
def test_a_key_stops_from_anywhere_but_the_control_that_has_the_focus(
    browser: webdriver.Chrome, shown: Page, run: Run, key: str
) -> None:
    browser.find_element(By.ID, "theme").click()  # a click leaves the space bar to Stop
    browser.find_element(By.ID, "theme").click()
    ActionChains(browser).send_keys(key).perform()
    wait(browser, lambda: run.finger.muted_because == EMERGENCY_STOP)


def test_a_stop_is_released_by_holding_a_key(
    browser: webdriver.Chrome, shown: Page, run: Run
) -> None:
    button = browser.find_element(By.ID, "stop")
    browser.execute_script("arguments[0].focus()", button)
    ActionChains(browser).send_keys(Keys.ENTER).perform()
    wait(browser, lambda: text(browser, "life") == "stopped")
    ActionChains(browser).key_down(Keys.ENTER).pause(2).key_up(Keys.ENTER).perform()
    wait(browser, lambda: run.state.armed)


def press(browser: webdriver.Chrome, *kinds: tuple[str, dict[str, object]]) -> None:
    """Send events of the browser's own protocol."""
    for kind, event in kinds:
        browser.execute_cdp_cmd(f"Input.dispatch{kind}Event", event)


def middle(browser: webdriver.Chrome, name: str) -> tuple[float, float]:
    """Return the middle of an element."""
    place = browser.execute_script(
        "const box = document.getElementById(arguments[0]).getBoundingClientRect();"
        "return [box.x + box.width / 2, box.y + box.height / 2];",
        name,
    )
    return place[0], place[1]


def touches(
    browser: webdriver.Chrome, kind: str, count: int
) -> tuple[str, dict[str, object]]:
    """Return the event of as many fingers on Stop."""
    x, y = middle(browser, "stop")
    points = [{"x": x + 6 * k, "y": y, "id": k} for k in range(count)]
    return "Touch", {"type": f"touch{kind}", "touchPoints": points}


def key(kind: str, name: str) -> tuple[str, dict[str, object]]:
    """Return the event of a key: Enter or the space bar."""
    code, number = {" ": ("Space", 32), "Enter": ("Enter", 13)}[name]
    event = {"key": name, "code": code, "windowsVirtualKeyCode": number}
    return "Key", {"type": f"key{kind}", **event}


def mouse(
    browser: webdriver.Chrome, kind: str, name: str, button: str = "left"
) -> tuple[str, dict[str, object]]:
    """Return the event of a mouse over an element."""
    x, y = middle(browser, name)
    event = {"x": x, "y": y, "button": button, "clickCount": 1}
    return "Mouse", {"type": f"mouse{kind}", **event}


@pytest.mark.parametrize("by", ["hand", "rolled hand", "keys", "menu"])
def test_nothing_but_one_finger_or_key_that_holds_releases_a_stop(
    browser: webdriver.Chrome, page: Page, run: Run, by: str
) -> None:
    browser.get(page.url)
    wait(browser, lambda: text(browser, "life") == "live")
    press(browser, touches(browser, "Start", 1), touches(browser, "End", 0))
    wait(browser, lambda: text(browser, "life") == "stopped")
    if by == "hand":  # two fingers tap
        press(browser, touches(browser, "Start", 1), touches(browser, "Start", 2))
        press(browser, touches(browser, "End", 1), touches(browser, "End", 0))
    elif by == "rolled hand":  # two fingers lie on it
        press(browser, touches(browser, "Start", 1), touches(browser, "Start", 2))
    elif by == "keys":
        browser.execute_script("document.getElementById('stop').focus()")
        press(browser, key("Down", " "), key("Down", "Enter"))
        press(browser, key("Up", " "), key("Up", "Enter"))
    else:
        press(browser, mouse(browser, "Pressed", "stop", "right"))
    time.sleep(1.5)
    assert not run.state.armed
    if by == "rolled hand":
        press(browser, touches(browser, "End", 0))
    elif by == "menu":
        press(browser, mouse(browser, "Released", "stop", "right"))
    press(browser, touches(browser, "Start", 1))
    wait(browser, lambda: run.state.armed)
    press(browser, touches(browser, "End", 0))


def test_a_hold_releases_no_stop_that_came_during_it(
    browser: webdriver.Chrome, page: Page, run: Run
) -> None:
    browser.get(page.url)
    wait(browser, lambda: text(browser, "life") == "live")
    browser.find_element(By.ID, "stop").click()
    wait(browser, lambda: text(browser, "life") == "stopped")
    ActionChains(browser).click_and_hold(browser.find_element(By.ID, "stop")).perform()
    Watcher(run.telemetry.name).ask("stop")
    time.sleep(2)
    assert not run.state.armed
    ActionChains(browser).release().click_and_hold().perform()
    wait(browser, lambda: run.state.armed)
    ActionChains(browser).release().perform()


@pytest.mark.parametrize("gap", [0.2, 0.4])
def test_a_double_click_on_mute_mutes(
    browser: webdriver.Chrome, page: Page, run: Run, gap: float
) -> None:
    browser.get(page.url)
    wait(browser, lambda: text(browser, "life") == "live")
    browser.execute_script(
        "for (let k = 0; k < 4; k++)"
        " setTimeout(() => document.getElementById('mute').click(), k * arguments[0]);",
        1000 * gap,
    )
    time.sleep(4 * gap + 0.5)
    assert not run.state.armed
    wait(browser, lambda: text(browser, "mute") == "Resume")
    browser.find_element(By.ID, "mute").click()
    wait(browser, lambda: run.state.armed)


def test_a_press_that_was_meant_for_mute_arms_nothing(
    browser: webdriver.Chrome, page: Page, run: Run
) -> None:
    """Somebody else mutes just before it; and Enter that is held is one press."""
    browser.get(page.url)
    wait(browser, lambda: text(browser, "life") == "live")
    run.state = replace(run.state, fingers=(replace(run.finger, armed=False),))
    wait(browser, lambda: text(browser, "mute") != "Mute")
    browser.find_element(By.ID, "mute").click()
    time.sleep(0.5)
    assert not run.state.armed
    browser.execute_script("document.getElementById('mute').focus()")
    for _ in range(20):
        press(browser, key("Down", "Enter"))
        time.sleep(0.1)
    press(browser, key("Up", "Enter"))
    time.sleep(0.3)
    assert not run.state.armed


def test_the_stone_box_starts_until_sound_arrives_and_is_muted_only_when_told_twice(
    browser: webdriver.Chrome, run: Run, tmp_path: Path
) -> None:
    _, finger = Pipe(duplex=False)
    cold = Run(run.telemetry.name + "-cold")
    cold.silent = True  # a run that has rendered nothing yet
    with cold:
        box = GameSettings(
            cold.telemetry.name,
            [(Touch.ROUGH,) * 5],
            7,
            finger,
            tmp_path / "results.jsonl",
        )
        with serve_game(box) as page:
            browser.get(page.url)
            wait(browser, lambda: text(browser, "life") == "starting")
            assert text(browser, "cause").startswith("The simulated finger starts: ")
            assert not can_press(browser, "begin")
            cold.silent = False
            wait(browser, lambda: text(browser, "life") == "ready")
            assert can_press(browser, "begin")
            assert can_press(browser, "stop")
            browser.get("about:blank")  # or it would seek the server that has ended
    box = GameSettings(
        run.telemetry.name, [(Touch.ROUGH,) * 5], 7, finger, tmp_path / "results.jsonl"
    )
    with serve_game(box) as page:
        browser.get(page.url)
        wait(browser, lambda: text(browser, "life") == "ready")
        browser.find_element(By.ID, "mute").click()
        wait(browser, lambda: text(browser, "life") == "muted")
        browser.find_element(By.ID, "begin").click()
        assert "nobody would feel this round" in text(browser, "question")
        browser.find_element(By.ID, "begin").click()
        wait(browser, lambda: browser.find_element(By.ID, "done").is_displayed())
        assert not run.state.armed
        browser.get("about:blank")


def test_a_replay_says_so(browser: webdriver.Chrome, page: Page, run: Run) -> None:
    run.state = replace(run.state, role="replay")
    browser.get(page.url)
    wait(browser, lambda: text(browser, "life") == "replay")
    assert "Feel it here" in text(browser, "cause")
    assert seen(browser) == ["life", "cause", "mute", "stop"]
    browser.find_element(By.ID, "stop").click()
    wait(browser, lambda: text(browser, "life") == "stopped")


def test_the_robots_page_shows_what_it_hears_in_every_view(
    browser: webdriver.Chrome, page: Page, run: Run
) -> None:
    run.state = replace(run.state, role="robot", link="connected to desk")
    browser.get(page.url)
    wait(browser, lambda: "robot's side" in text(browser, "cause"))
    for name in ("health", "contact-wave", "spectrogram", "contact-meter", "link"):
        assert browser.find_element(By.ID, name).is_displayed(), name
    for name in ("views", "hero", "timeline", "feel", "level", "threshold", "profile"):
        assert not browser.find_element(By.ID, name).is_displayed(), name
    resize(browser, 390, 844)
    assert browser.find_element(By.ID, "contact-wave").size["width"] > 300


def test_a_run_that_waits_for_sound_is_stopped_like_any(
    browser: webdriver.Chrome, run: Run
) -> None:
    cold = Run(run.telemetry.name + "-cold")
    cold.silent = True  # it may vibrate all the same: by Buzz now
    with cold, watch(cold.telemetry.name) as page:
        browser.get(page.url)
        wait(browser, lambda: can_press(browser, "stop"))
        assert text(browser, "life") == "waiting"
        browser.find_element(By.ID, "mute").click()
        wait(browser, lambda: "It is muted" in text(browser, "cause"))
        browser.find_element(By.ID, "stop").click()
        wait(browser, lambda: text(browser, "life") == "stopped")
        hold = browser.find_element(By.ID, "stop")
        ActionChains(browser).click_and_hold(hold).pause(1.2).release().perform()
        wait(browser, lambda: cold.state.armed)
        browser.get("about:blank")  # or it would seek the server that has ended


LUMINANCE = """
const canvas = document.querySelector(arguments[0]);
const copy = new OffscreenCanvas(canvas.width, canvas.height);
const paint = copy.getContext("2d", {willReadFrequently: true});
paint.drawImage(canvas, 0, 0);
const { data } = paint.getImageData(0, 0, 40, canvas.height);
const linear = (c) => c / 255 <= 0.04045 ? c / 255 / 12.92
  : ((c / 255 + 0.055) / 1.055) ** 2.4;
let darkest = 1;
for (let k = 0; k < data.length; k += 4) {
  if (data[k + 3] < 200) continue;
  const [r, g, b] = data.slice(k, k + 3).map(linear);
  darkest = Math.min(darkest, 0.2126 * r + 0.7152 * g + 0.0722 * b);
}
let node = canvas, opacity = 1;
for (; node; node = node.parentElement) opacity *= getComputedStyle(node).opacity;
return [darkest, opacity];
"""


def test_a_chart_without_fresh_data_keeps_its_words_readable(
    browser: webdriver.Chrome, page: Page, run: Run
) -> None:
    light = [{"name": "prefers-color-scheme", "value": "light"}]
    browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": light})
    browser.get(page.url)
    wait(browser, lambda: text(browser, "life") == "live")
    run.silent = True
    wait(browser, lambda: text(browser, "life").startswith("no data"))
    darkest, opacity = browser.execute_script(LUMINANCE, "#timeline canvas")
    assert opacity == 1
    # The axis stands on the panel, which is as good as white.
    assert (0.98 + 0.05) / (darkest + 0.05) >= 4.5
