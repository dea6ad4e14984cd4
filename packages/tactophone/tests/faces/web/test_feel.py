"""The page as the fingertip, in a real browser with a recorded motor: what it renders,
and that it falls silent."""

import itertools
import time
from collections.abc import Callable, Iterator
from dataclasses import replace

import pytest
from selenium import webdriver
from selenium.webdriver.common.by import By

from tactophone.core.types import Touch
from tactophone.faces.web.server import Page, watch
from tactophone.live.telemetry.watcher import Watcher
from tests.browser import text, wait
from tests.faces.web.running import Run

pytestmark = pytest.mark.realtime

RECORD = (
    "window.calls = []; "
    "const note = (...call) => window.calls.push([performance.now(), ...call]);"
)
PHONE = (
    RECORD + "const data = { get: () => ({ mobile: true }) };"
    "Object.defineProperty(navigator, 'userAgentData', data);"
    "navigator.vibrate = (pattern) => { note(pattern); return true; };"
)
PAD = (
    RECORD + "const pad = { connected: true, vibrationActuator: {"
    "playEffect: async (kind, effect) => { note(kind, effect); }, "
    "reset: async () => { note('reset'); } } };"
    "navigator.getGamepads = () => [null, pad];"
)
IPHONE = (
    "const agent = { get: () => 'Mozilla/5.0 (iPhone; CPU iPhone OS 18_0)' };"
    "Object.defineProperty(navigator, 'userAgent', agent);"
    "delete Navigator.prototype.vibrate;"
)


@pytest.fixture
def inject(browser: webdriver.Chrome) -> Iterator[Callable[[str], None]]:
    """Run a script before any of the page's, until the test ends."""
    scripts = []

    def add(source: str) -> None:
        scripts.append(
            browser.execute_cdp_cmd(
                "Page.addScriptToEvaluateOnNewDocument", {"source": source}
            )
        )

    yield add
    for script in scripts:
        browser.execute_cdp_cmd("Page.removeScriptToEvaluateOnNewDocument", script)


def feel(browser: webdriver.Chrome, page: Page) -> None:
    browser.get(page.url)
    wait(browser, lambda: text(browser, "life") == "live")
    browser.find_element(By.ID, "feel").click()
    wait(browser, lambda: text(browser, "feel-way") != "")


def calls(browser: webdriver.Chrome) -> list:
    """What the motor was asked for since the last look."""
    found = browser.execute_script(
        "const found = window.calls; window.calls = []; return found;"
    )
    assert isinstance(found, list)
    return found


def settled(browser: webdriver.Chrome, seconds: float = 0.5) -> list:
    time.sleep(0.3)
    calls(browser)
    time.sleep(seconds)
    return calls(browser)


def test_a_phone_buzzes_for_rough_and_ticks_for_smooth(
    browser: webdriver.Chrome, page: Page, run: Run, inject: Callable[[str], None]
) -> None:
    inject(PHONE)
    feel(browser, page)
    assert "in this phone" in text(browser, "feel-way")
    run.touch = Touch.ROUGH
    trains = [call[1] for call in settled(browser) if call[1]]  # 0 ends a train
    assert trains
    assert all(train[:2] == [8, 8] and sum(train) <= 120 for train in trains)
    run.touch = Touch.SMOOTH
    assert {tuple(call[1]) for call in settled(browser) if call[1]} == {(10,)}
    run.touch = Touch.NONE
    assert settled(browser) == []


def test_a_gamepad_comes_first_with_effects_that_end_by_themselves(
    browser: webdriver.Chrome, page: Page, run: Run, inject: Callable[[str], None]
) -> None:
    inject(PHONE + PAD.removeprefix(RECORD))
    feel(browser, page)
    assert "in the gamepad" in text(browser, "feel-way")
    run.touch = Touch.ROUGH
    # A busy machine may be late by 150 ms, and the page is then silent for a while.
    found = [call for call in settled(browser, 1.0) if call[1] != "reset"]
    effects = [call[2] for call in found]
    assert {call[1] for call in found} == {"dual-rumble"}
    assert all(0 < effect["duration"] <= 120 for effect in effects)
    assert all(
        effect["weakMagnitude"] < effect["strongMagnitude"] <= 0.5 for effect in effects
    )
    gaps = sorted(later[0] - earlier[0] for earlier, later in itertools.pairwise(found))
    assert gaps[len(gaps) // 2] < 100  # ms: each is refreshed before it ends
    run.touch = Touch.SMOOTH
    effects = [call[2] for call in settled(browser) if call[1] != "reset"]
    assert all(
        effect["strongMagnitude"] < effect["weakMagnitude"] < 0.5 for effect in effects
    )


@pytest.mark.parametrize("end", ["run", "mute", "hidden", "stop"])
def test_the_motor_rests_whatever_ends_the_vibration(
    browser: webdriver.Chrome,
    page: Page,
    run: Run,
    inject: Callable[[str], None],
    end: str,
) -> None:
    inject(PAD)
    feel(browser, page)
    run.touch = Touch.ROUGH
    wait(browser, lambda: calls(browser))
    script = {
        "hidden": "const hidden = { get: () => true, configurable: true };"
        "Object.defineProperty(document, 'hidden', hidden);"
        "document.dispatchEvent(new Event('visibilitychange'));",
        "stop": "document.getElementById('feel').click();",
        "mute": "document.getElementById('mute').click();",
    }.get(end, "")
    begin = browser.execute_script(script + "return performance.now();")
    if end == "run":
        run.pause()
    time.sleep(0.6)
    found = calls(browser)
    resets = [call[0] for call in found if call[1] == "reset"]
    assert resets
    assert found[-1][1] == "reset"
    assert resets[0] - begin < (60 if end in ("hidden", "stop") else 500)


def test_a_page_that_stood_still_renders_nothing_that_was_made_long_before(
    browser: webdriver.Chrome, page: Page, run: Run, inject: Callable[[str], None]
) -> None:
    """It was stopped meanwhile; what had come before the stop waited in the page."""
    inject(PAD)
    feel(browser, page)
    run.touch = Touch.ROUGH
    wait(browser, lambda: calls(browser))
    browser.execute_script(
        "setTimeout(() => { const until = performance.now() + 4000;"
        " while (performance.now() < until); window.since = performance.now(); }, 500);"
    )
    time.sleep(1.5)
    Watcher(run.telemetry.name).ask("stop")
    wait(browser, lambda: browser.execute_script("return window.since"))
    time.sleep(0.7)
    since = browser.execute_script("return window.since")
    found = [call for call in calls(browser) if call[0] >= since]
    assert [(call[0] - since, *call[1:]) for call in found if call[1] != "reset"] == []
    Watcher(run.telemetry.name).ask("arm")
    wait(browser, lambda: calls(browser))  # and goes on with what is new


def test_an_iphone_is_said_to_have_no_vibration_and_gets_sound(
    browser: webdriver.Chrome, page: Page, inject: Callable[[str], None]
) -> None:
    inject(IPHONE)
    feel(browser, page)
    wait(browser, lambda: "gives web pages no vibration" in text(browser, "feel-way"))
    assert "as sound" in text(browser, "feel-way")


def test_without_a_gamepad_the_page_says_what_to_do(
    browser: webdriver.Chrome, page: Page
) -> None:
    feel(browser, page)
    assert "as sound" in text(browser, "feel-way")
    browser.find_element(By.ID, "feel-by").send_keys("gamepad")
    wait(browser, lambda: "press any of its buttons" in text(browser, "feel-way"))


def test_a_name_that_is_no_secure_context_vibrates_and_says_why_there_is_no_sound(
    browser: webdriver.Chrome, run: Run, inject: Callable[[str], None]
) -> None:
    """Chromium resolves the name to this machine, but does not trust it as it does
    127.0.0.1."""
    inject(PHONE)
    run.state = replace(run.state, source="browser")
    with watch(run.telemetry.name, names=("phone.test",)) as page:
        browser.get(page.url.replace("127.0.0.1", "phone.test"))
        assert browser.execute_script("return isSecureContext") is False
        wait(browser, lambda: text(browser, "life") == "live")
        browser.find_element(By.ID, "feel").click()
        run.touch = Touch.ROUGH
        wait(browser, lambda: calls(browser))
        wait(browser, lambda: "Start again with --https" in text(browser, "feel-way"))
        browser.get(page.url.replace("127.0.0.1", "phone.test") + "try")
        browser.find_element(By.ID, "listen").click()
        wait(browser, lambda: "secure address" in text(browser, "listen-state"))
        browser.get("about:blank")
    complaints = [entry["message"] for entry in browser.get_log("browser")]
    # Chromium says that it ignores one header there; nothing else may go wrong.
    assert [
        words for words in complaints if "Cross-Origin-Opener-Policy" not in words
    ] == []


def test_a_rebound_name_stays_refused(browser: webdriver.Chrome, page: Page) -> None:
    browser.get(page.url.replace("127.0.0.1", "other.test"))
    assert "Refused" in browser.find_element(By.TAG_NAME, "body").text
    browser.get_log("browser")  # the refusal, and the icon that it refused too


def test_silence_that_piled_up_does_not_delay_a_vibration(
    browser: webdriver.Chrome, page: Page
) -> None:
    """A tenth of a second of silence is buffered when a vibration comes: it sounds
    within a message's length."""
    browser.get(page.url)
    onset = browser.execute_async_script(
        """
        const done = arguments[0];
        (async () => {
          const context = new OfflineAudioContext(1, 48000, 48000);
          await context.audioWorklet.addModule("static/vibration.js");
          const options = { numberOfInputs: 0, outputChannelCount: [1] };
          const node = new AudioWorkletNode(context, "vibration", options);
          node.connect(context.destination);
          const silence = new Float32Array(480);
          const sound = new Float32Array(480).fill(0.5);
          for (let k = 0; k < 10; k++) node.port.postMessage(silence);
          for (let k = 0; k < 5; k++) node.port.postMessage(sound);
          await new Promise((settled) => setTimeout(settled, 200));
          const [played] = [(await context.startRendering()).getChannelData(0)];
          done(played.findIndex((sample) => sample !== 0));
        })().catch((error) => done(String(error)));
        """
    )
    assert 0 <= onset < 480


def test_the_buffer_of_the_sound_grows_while_a_connection_stalls_and_shrinks_after_that(
    browser: webdriver.Chrome, page: Page
) -> None:
    """In virtual time: 10 s of a message each 5 ms, 10 s in which it stalls for 35 ms
    twice a second, 60 s without."""
    browser.get(page.url)
    first, stalled, last = browser.execute_async_script(
        """
        const done = arguments[0];
        Object.assign(globalThis, {
          sampleRate: 48000,
          currentTime: 0,
          AudioWorkletProcessor: class { port = { postMessage() {} }; },
          registerProcessor: (name, kind) => { globalThis.Vibration = kind; },
        });
        (async () => {
          await import(new URL("static/vibration.js", location.href));
          const node = new Vibration();
          const out = new Float32Array(128);
          let sent = 0, time = 0;
          // Median delay in the last second, in ms.
          const delay = (seconds, stalls) => {
            const found = [];
            for (const end = time + seconds * 48000; time < end; time += 128) {
              while (sent + 240 <= time && !(stalls && time % 24000 < 1680)) {
                const data = Float32Array.from({ length: 240 }, (_, k) => sent + k + 1);
                node.port.onmessage({ data });
                sent += 240;
              }
              out.fill(0);
              node.process([], [[out]]);
              if (out[0] && time > end - 48000) found.push((time - out[0]) / 48);
            }
            return found.sort((a, b) => a - b)[found.length >> 1];
          };
          done([delay(10, false), delay(10, true), delay(60, false)]);
        })().catch((error) => done([String(error), 0, 0]));
        """
    )
    assert 5 < first < 15
    assert stalled > first + 10
    assert last < first + 2


def test_a_double_click_on_stop_feeling_stops(
    browser: webdriver.Chrome, page: Page, run: Run, inject: Callable[[str], None]
) -> None:
    inject(PAD)
    feel(browser, page)
    run.touch = Touch.ROUGH
    wait(browser, lambda: calls(browser))
    browser.execute_script(
        "const press = () => document.getElementById('feel').click();"
        "press(); setTimeout(press, 300);"
    )
    time.sleep(0.6)
    calls(browser)
    time.sleep(0.5)
    assert calls(browser) == []


def test_sound_never_passes_the_ceiling_at_any_volume(
    browser: webdriver.Chrome, page: Page, run: Run, inject: Callable[[str], None]
) -> None:
    """Measured where it leaves the page, with overtones, from its onset on."""
    inject(
        "window.peak = 0; const connect = AudioNode.prototype.connect;"
        "AudioNode.prototype.connect = function (to, ...rest) {"
        " if (to instanceof AudioDestinationNode) {"
        "  const tap = new AnalyserNode(this.context, { fftSize: 4096 });"
        "  connect.call(this, tap); const samples = new Float32Array(4096);"
        "  setInterval(() => { tap.getFloatTimeDomainData(samples);"
        "   for (const x of samples) window.peak = Math.max(window.peak, Math.abs(x));"
        "  }, 20); }"
        " return connect.call(this, to, ...rest); };"
    )
    run.state = replace(run.state, fingers=(replace(run.finger, ceiling=0.5),))
    feel(browser, page)
    browser.execute_script(
        "const volume = document.getElementById('feel-volume'); volume.value = 1;"
        "volume.dispatchEvent(new Event('input'));"
    )
    for _ in range(4):
        run.touch = Touch.ROUGH  # 0.5, as strong as the ceiling
        time.sleep(0.5)
        run.touch = Touch.NONE
        time.sleep(0.5)
    assert 0.1 < browser.execute_script("return window.peak") <= 0.5001


def test_sound_is_loaded_once_however_fast_the_button_is_pressed(
    browser: webdriver.Chrome, page: Page, inject: Callable[[str], None]
) -> None:
    inject(
        "window.nodes = 0; const Node = AudioWorkletNode;"
        "window.AudioWorkletNode = class extends Node { "
        "constructor(...all) { super(...all); window.nodes++; } };"
    )
    browser.get(page.url)
    wait(browser, lambda: text(browser, "life") == "live")
    browser.execute_script(
        "for (let k = 0; k < 5; k++) document.getElementById('feel').click();"
    )
    button = browser.find_element(By.ID, "feel")
    assert button.get_attribute("aria-pressed") == "false"  # a slip feels nothing
    time.sleep(1.1)
    button.click()
    wait(browser, lambda: "as sound" in text(browser, "feel-way"))
    time.sleep(0.5)
    assert browser.execute_script("return window.nodes") == 1
    assert button.get_attribute("aria-pressed") == "true"
