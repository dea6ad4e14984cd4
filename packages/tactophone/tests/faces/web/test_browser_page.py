"""The page that listens, in Chromium: its own functions find what the product finds,
also by the microphone."""

import base64
import functools
import gzip
import http.server
import json
import math
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import soundfile
from selenium import webdriver
from selenium.webdriver.common.action_chains import ActionChains
from selenium.webdriver.common.by import By
from selenium.webdriver.common.keys import Keys

from benchmarks.no_touch_sounds import NO_TOUCH_RATE, draw_no_touch
from tactophone.app.listen import serve_listening, write_listening_site
from tactophone.core.types import FloatArray, Prediction
from tactophone.faces.web import views
from tactophone.signal.perception.evidence import TouchEvidence
from tactophone.signal.perception.levels import banded_dbfs
from tactophone.signal.perception.model_file import read_model
from tactophone.signal.perception.models import model_path, open_touch_detector
from tactophone.signal.perception.resample import Resampler
from tests.accessibility import needs_axe, serious_faults
from tests.browser import resize, start_chromium, text, wait
from tests.node import NODE, needs_node
from tests.sounds import blocks, noise

pytestmark = pytest.mark.realtime

RATE = 48_000
THRESHOLD_DBFS = -45.0


class Quiet(http.server.SimpleHTTPRequestHandler):
    def log_message(self, *_: object) -> None:
        pass


@contextmanager
def served(folder: Path) -> Iterator[str]:
    with http.server.ThreadingHTTPServer(
        ("127.0.0.1", 0), functools.partial(Quiet, directory=str(folder))
    ) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        yield f"http://127.0.0.1:{server.server_port}/index.html"
        server.shutdown()


def begin(browser: webdriver.Chrome) -> None:
    """Press the button once the model is loaded, and wait until the page listens."""
    button = browser.find_element(By.ID, "listen")
    wait(browser, button.is_enabled, 30)
    button.click()
    wait(browser, lambda: text(browser, "cause") == "Scratch something.", 30)


@pytest.fixture(scope="module")
def address(tmp_path_factory: pytest.TempPathFactory) -> Iterator[str]:
    """The page, written as a site and served as any is."""
    folder = tmp_path_factory.mktemp("site")
    write_listening_site(folder)
    with served(folder) as address:
        yield address


def scratches(*, seconds: float = 8.0) -> FloatArray:
    """Faint noise; from 2 s on strokes of hiss, from 5 s on with clicks in them."""
    rng = np.random.default_rng(1)
    at = np.arange(round(seconds * RATE)) / RATE
    hiss = 0.05 * rng.standard_normal(len(at))
    clicks = 0.7 * (rng.uniform(size=len(at)) < 0.002) * rng.choice([-1, 1], len(at))
    rough = np.convolve(clicks, np.exp(-np.arange(200) / 20), "same")
    stroke = (at > 2) & (at % 1 < 0.6)
    sound = stroke * np.clip(np.where(at < 5, hiss, hiss + rough), -0.95, 0.95)
    return (sound + 1e-3 * rng.standard_normal(len(at))).astype(np.float32)


def by_the_product(sound: FloatArray, rate: int = RATE) -> list[Prediction]:
    """What is felt where a threshold is given, so that the level decides on contact."""
    detector = open_touch_detector("stylus", sample_rate=rate, contact="level")
    detector.threshold.dbfs = THRESHOLD_DBFS
    whole = blocks(sound[:, None], 480, sample_rate=rate)
    return [prediction for block in whole for prediction in detector.push(block)]


BY_THE_PAGE = """
const [rate, threshold, sound, done] = arguments;
(async () => {
  const { openModel } = await import("./static/listen/listen.js");
  const { Detector } = await import("./static/listen/model.js");
  const detector = new Detector(await openModel(), rate);
  detector.thresholdDbfs = threshold;
  const bytes = Uint8Array.from(atob(sound), (c) => c.charCodeAt(0));
  const samples = new Float32Array(bytes.buffer);
  const found = [];
  for (let k = 0; k < samples.length; k += 256) {
    found.push(...await detector.push(samples.slice(k, k + 256)));
  }
  done(found);
})().catch((error) => done(String(error)));
"""


def by_the_page(
    browser: webdriver.Chrome, sound: FloatArray, rate: int = RATE
) -> list[dict[str, Any]]:
    browser.set_script_timeout(60)
    encoded = base64.b64encode(sound.tobytes()).decode()
    found = browser.execute_async_script(BY_THE_PAGE, rate, THRESHOLD_DBFS, encoded)
    assert isinstance(found, list), found
    return found


def newest(expected: list[Prediction], ends: list[float]) -> list[Prediction]:
    """The product's newest prediction at the end of each window: between two windows
    it also says when contact changes."""
    times = np.array([each.end for each in expected])
    return [expected[np.searchsorted(times, end + 1e-6) - 1] for end in ends]


def assert_same_touch(
    found: list[dict[str, Any]], expected: list[Prediction], share: float
) -> None:
    assert len(found) > 300
    wanted = newest(expected, [row["end"] for row in found])
    numbers = np.array([row["probabilities"] for row in found])
    assert np.abs(numbers - [each.probabilities for each in wanted]).max() < 1e-3
    same = [
        row["touch"] == each.touch.name.lower()
        for row, each in zip(found, wanted, strict=True)
    ]
    assert np.mean(same) >= share


def test_the_same_sound_is_felt_as_by_the_product(
    browser: webdriver.Chrome, address: str
) -> None:
    browser.get(address)
    expected = by_the_product(scratches())
    assert len({each.touch for each in expected}) == 3
    assert_same_touch(by_the_page(browser, scratches()), expected, 0.97)


def test_its_evidence_is_the_products(browser: webdriver.Chrome, address: str) -> None:
    browser.get(address)
    found = by_the_page(browser, scratches())
    evidence = TouchEvidence(read_model(model_path("stylus")).card.decision)
    compared = set()
    for row in found:
        if row["contact"]:
            evidence.hear(tuple(row["probabilities"]), row["end"])
            touch = "rough" if evidence.is_rough(row["end"]) else "smooth"
            roughness = evidence.roughness(row["end"])
            assert row["touch"] == touch
            assert row["roughness"] == pytest.approx(roughness, abs=1e-9)
            assert row["unknown"] == evidence.is_unknown(row["end"])
            compared.add((touch, row["unknown"]))
    assert {("smooth", False), ("smooth", True), ("rough", False)} <= compared


def test_a_voice_is_noticed_and_then_never_rough(
    browser: webdriver.Chrome, address: str
) -> None:
    browser.get(address)
    sound = draw_no_touch("voice", 6.0, 500)[:, 0]
    found = by_the_page(browser, sound, NO_TOUCH_RATE)
    first = next(place for place, row in enumerate(found) if not row["isTouch"])
    assert found[first]["end"] < 5.0
    words = {row["touch"] for row in found[first:] if not row["isTouch"]}
    assert words == {"none", "smooth"}
    assert_same_touch(found, by_the_product(sound, NO_TOUCH_RATE), 0.97)


def test_real_sound_at_44100_hz_is_felt_as_by_the_product(
    browser: webdriver.Chrome, address: str, recordings: Path
) -> None:
    browser.get(address)
    sound, rate = soundfile.read(
        recordings / "lmt" / "G1RhombAluminumMesh_01.flac", dtype="float32"
    )
    expected = by_the_product(sound, rate)
    assert_same_touch(by_the_page(browser, sound, rate), expected, 0.9)


def test_no_vibration_is_over_half_of_full_drive(
    browser: webdriver.Chrome, address: str
) -> None:
    browser.get(address)
    strongest = browser.execute_async_script(
        "const done = arguments[0];"
        "const rough = { touch: 'rough', roughness: 1 };"
        "const none = { touch: 'none', roughness: 1 };"
        "import('./static/listen/listen.js').then(({ vibration }) => "
        "done([vibration(rough, 5), vibration(none, 0.5)]));"
    )
    assert [each["amplitude"] for each in strongest] == [0.5, 0]


@needs_axe
def test_it_has_no_serious_fault_of_accessibility(
    browser: webdriver.Chrome, address: str
) -> None:
    browser.get(address)
    assert serious_faults(browser) == []


@pytest.fixture
def listener(tmp_path: Path) -> Iterator[webdriver.Chrome]:
    """A browser whose microphone is a file, played once."""
    path = tmp_path / "microphone.wav"
    soundfile.write(
        path,
        np.concatenate(
            [scratches(seconds=30), noise(level_dbfs=-60, channels=1)[:, 0]]
        ),
        RATE,
    )
    browser = start_chromium(
        "--use-fake-ui-for-media-stream",
        "--use-fake-device-for-media-stream",
        f"--use-file-for-fake-audio-capture={path}%noloop",
    )
    yield browser
    browser.quit()


def history(browser: webdriver.Chrome) -> list[dict[str, Any]]:
    found: list[dict[str, Any]] = browser.execute_async_script(
        "const done = arguments[0]; "
        "import('./static/listen/listen.js').then(({ history }) => done(history));"
    )
    return found


def share_agreed(found: list[dict[str, Any]], sound: FloatArray) -> float:
    """The share of words that are the product's; the file began before the page
    listened, and levels show how long."""
    at_16_khz = Resampler(RATE, 16_000, channels=1).push(sound[: 10 * RATE, None])[:, 0]
    levels = np.array([row["level"] for row in found[:300]])

    def error(shift: int) -> float:
        windows = (at_16_khz[shift + 160 * k :][:512] for k in range(len(levels)))
        return float(
            np.abs([banded_dbfs(window) for window in windows] - levels).mean()
        )

    coarse = np.array(
        [
            banded_dbfs(at_16_khz[at : at + 512])
            for at in range(0, len(at_16_khz) - 512, 8)
        ]
    )
    errors = [
        np.abs(coarse[shift : shift + 20 * len(levels) : 20] - levels).mean()
        for shift in range(10_000)
    ]
    nearest = 8 * int(np.argmin(errors))
    shift = min(range(max(0, nearest - 8), nearest + 9), key=error)
    ends = [row["end"] for row in found]
    expected = newest(by_the_product(sound[3 * shift :]), ends)
    return float(
        np.mean(
            [
                row["touch"] == each.touch.name.lower()
                for row, each in zip(found, expected, strict=True)
            ]
        )
    )


def test_by_the_microphone_the_words_are_the_products(
    listener: webdriver.Chrome, address: str
) -> None:
    listener.get(f"{address}?threshold={THRESHOLD_DBFS}")
    begin(listener)
    wait(listener, lambda: len(history(listener)) > 1100, 30)
    found = history(listener)
    listener.find_element(By.ID, "stop").click()
    assert text(listener, "life") == "stopped"
    assert text(listener, "decision") == "–"
    agreed = share_agreed(found, scratches(seconds=30))
    assert len(found) > 1000
    assert {row["touch"] for row in found} == {"none", "smooth", "rough"}
    assert agreed >= 0.95
    ended = len(history(listener))
    time.sleep(0.3)
    assert len(history(listener)) == ended


def test_the_threshold_is_measured_in_silence(
    listener: webdriver.Chrome, address: str
) -> None:
    listener.get(address)
    begin(listener)
    expected = max(each.level_dbfs for each in by_the_product(scratches(seconds=1.5)))
    found = float(
        listener.find_element(By.ID, "threshold").get_attribute("value") or math.nan
    )
    assert expected < found < expected + 6
    wait(listener, lambda: text(listener, "decision") in ("smooth", "rough"), 10)


def test_space_silences_the_page_and_its_level(
    listener: webdriver.Chrome, address: str
) -> None:
    listener.get(f"{address}?threshold={THRESHOLD_DBFS}")
    begin(listener)
    level = listener.find_element(By.CSS_SELECTOR, "#microphone-meter output")
    wait(listener, lambda: "dBFS" in level.text, 10)
    ActionChains(listener).send_keys(Keys.SPACE).perform()
    wait(listener, lambda: text(listener, "life") == "stopped")
    assert level.text == "–"
    assert text(listener, "listen") == "Use this microphone"


def test_the_verbs_own_server_allows_it_all_that_it_needs(
    listener: webdriver.Chrome,
) -> None:
    with serve_listening() as page:
        listener.get(f"{page.url}?threshold={THRESHOLD_DBFS}")
        begin(listener)
        wait(listener, lambda: text(listener, "decision") in ("smooth", "rough"), 20)
        loud = [entry["message"] for entry in listener.get_log("browser")]
        assert loud == []


def test_it_says_what_it_lacks(browser: webdriver.Chrome, tmp_path: Path) -> None:
    write_listening_site(tmp_path)
    (tmp_path / "model.onnx").unlink()
    with served(tmp_path) as address:
        browser.get(address)
        wait(browser, lambda: text(browser, "life") == "not loaded")
        assert text(browser, "cause") == "model.onnx is missing beside this page"
        assert not browser.find_element(By.ID, "listen").is_enabled()
        browser.get_log("browser")  # the file that is missing


@pytest.mark.parametrize("width", [390, 1280])
def test_what_to_press_is_above_the_fold(
    browser: webdriver.Chrome, address: str, width: int
) -> None:
    resize(browser, width, 844)
    browser.get(address)
    button = browser.find_element(By.ID, "listen")
    wait(browser, button.is_enabled, 30)
    assert button.rect["y"] + button.rect["height"] <= 844
    assert (
        browser.execute_script("return document.documentElement.scrollWidth") <= width
    )


@needs_node
def test_the_runtime_is_the_one_that_npm_has() -> None:
    ours = Path(str(views.STATIC)) / "vendor" / "onnxruntime-web"
    theirs = NODE / "node_modules" / "onnxruntime-web"
    wanted = json.loads((NODE / "package.json").read_text())["devDependencies"]
    version = json.loads((theirs / "package.json").read_text())["version"]
    assert version == wanted["onnxruntime-web"]
    packed = (ours / "ort-wasm-simd-threaded.wasm.gz").read_bytes()
    binary = theirs / "dist" / "ort-wasm-simd-threaded.wasm"
    assert gzip.decompress(packed) == binary.read_bytes()
    module = (theirs / "dist" / "ort.wasm.bundle.min.mjs").read_text()
    assert module.startswith((ours / "ort.wasm.bundle.min.mjs").read_text())
    assert version in (ours / "SOURCE.md").read_text()
