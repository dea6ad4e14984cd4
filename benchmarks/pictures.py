"""Pictures of the pages: those in `docs/images`, or every screen in every size and
theme, to be looked at.

``python benchmarks/pictures.py FOLDER`` writes the docs' pictures, and their words
beside them (`WORDS_FILE`); ``--all`` writes each screen of each page at the size of a
phone and of a laptop, light and dark. Needs Debian's chromium and chromium-driver.
"""

import argparse
import base64
import contextlib
import functools
import http.server
import json
import shutil
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

from selenium import webdriver
from selenium.webdriver.common.action_chains import ActionChains
from selenium.webdriver.common.by import By

from page import chromium, tactophone
from page_words import WORDS_FILE, fixed_words
from tactophone.app.listen import write_listening_site

DOCS = ((1280, "light"),)
ALL = tuple((width, theme) for width in (390, 1440) for theme in ("light", "dark"))
HEIGHTS = {390: 844, 1440: 900}
"""Of the window, by its width: a phone and a laptop."""
ROUGH_STONES = (2, 3)
"""Of the game with seed 5."""


def resize(browser: webdriver.Chrome, width: int, theme: str) -> None:
    """Give the page a size and a theme."""
    features = [{"name": "prefers-color-scheme", "value": theme}]
    browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": features})
    size = {
        "width": width,
        "height": HEIGHTS.get(width, 900),
        "deviceScaleFactor": 0.8,
        "mobile": width < 500,
    }
    browser.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", size)


def take(browser: webdriver.Chrome, path: Path, width: int) -> None:
    """Write the whole page as it is now."""
    end = browser.execute_script(
        "return document.body.getBoundingClientRect().bottom + scrollY"
    )
    clip = {"x": 0, "y": 0, "width": width, "height": end, "scale": 1}
    shot = browser.execute_cdp_cmd(
        "Page.captureScreenshot",
        {"captureBeyondViewport": True, "format": "png", "clip": clip},
    )
    path.write_bytes(base64.b64decode(shot["data"]))


def pictures(
    browser: webdriver.Chrome,
    folder: Path,
    name: str,
    looks: tuple[tuple[int, str], ...],
) -> None:
    """Write the page in each size and theme, and for the docs its words too."""
    if looks is DOCS:
        note_words(folder / WORDS_FILE, f"{name}.png", fixed_words(browser))
    for width, theme in looks:
        suffix = "" if looks is DOCS else f"-{width}-{theme}"
        resize(browser, width, theme)
        if looks is not DOCS:
            time.sleep(0.8)  # until it is drawn anew
        take(browser, folder / f"{name}{suffix}.png", width)


def note_words(path: Path, name: str, words: list[str]) -> None:
    """Add the words of a picture to the file of all of them."""
    known = json.loads(path.read_text("utf-8")) if path.exists() else {}
    text = json.dumps({**known, name: words}, indent=1, sort_keys=True)
    path.write_text(text + "\n", encoding="utf-8")


def dashboard(
    browser: webdriver.Chrome, folder: Path, looks: tuple[tuple[int, str], ...]
) -> None:
    """The operator's page of a loopback over a busy wireless network, and the page of
    `try`."""
    arguments = (
        "loopback",
        "--source",
        "finger",
        "--actuator",
        "none",
        "--network",
        "wifi-busy",
        "--dashboard",
    )
    with tactophone(*arguments, "--name", "pictures") as url:
        browser.get(url)
        resize(browser, *looks[0])
        time.sleep(15)
        until, in_a_row = time.monotonic() + 150, 0
        while in_a_row < 7 and time.monotonic() < until:  # within a rough touch
            in_a_row = (
                in_a_row + 1
                if browser.find_element(By.ID, "decision").text == "rough"
                else 0
            )
            time.sleep(0.1)
        pictures(browser, folder, "dashboard", looks)
        if looks is not DOCS:
            browser.get(f"{url}try")
            time.sleep(2)
            pictures(browser, folder, "try", looks)


def stone_box(
    browser: webdriver.Chrome, folder: Path, looks: tuple[tuple[int, str], ...]
) -> None:
    """A round of the stone box, each stone stroked for some seconds."""
    with (
        tempfile.TemporaryDirectory() as results,
        contextlib.chdir(results),
        tactophone("play", "--no-open", "--seed", "5", "--name", "pictures-box") as url,
    ):
        browser.get(url)
        if looks is not DOCS:
            pictures(browser, folder, "stone-box-starting", looks[:2])
        wait(lambda: browser.find_element(By.ID, "begin").is_enabled(), 90)
        if looks is not DOCS:
            pictures(browser, folder, "stone-box-door", looks)
        browser.find_element(By.ID, "begin").click()
        for stone in range(5):
            stroke(browser, stone)
        if looks is not DOCS:
            pictures(browser, folder, "stone-box-play", looks)
        marks = browser.find_elements(By.CSS_SELECTOR, "#marks button")
        for stone in ROUGH_STONES:
            marks[stone].click()
        browser.find_element(By.ID, "done").click()
        time.sleep(1)
        pictures(browser, folder, "stone-box", looks)


def stroke(browser: webdriver.Chrome, stone: int) -> None:
    """Press on a stone, and move to and fro."""
    stage = browser.find_element(By.ID, "stage")
    width, height = stage.rect["width"], stage.rect["height"]
    along = int(width * ((0.0575 + 0.11 * stone) / 0.555 - 0.5))
    actions = (
        ActionChains(browser, duration=300)
        .move_to_element_with_offset(stage, along - 50, 0)
        .click_and_hold()
    )
    for turn in range(8):
        actions.move_by_offset(
            100 * (-1) ** turn, int(height / 20) * (-1) ** (turn // 2)
        )
    actions.release().perform()
    time.sleep(0.5)


def felt(
    browser: webdriver.Chrome, folder: Path, looks: tuple[tuple[int, str], ...]
) -> None:
    """The figure of `feel --plot`, of a run of the simulated competition; no page."""
    with tempfile.TemporaryDirectory() as place:
        command = [sys.executable, "-m", "tactophone"]
        simulate = ["simulate", "competition", "runs", "--runs", "1"]
        subprocess.run([*command, *simulate], cwd=place, check=True)
        sound = min(Path(place, "runs").rglob("*.flac"))
        feel = ["feel", str(sound), "--plot", "--out", place]
        subprocess.run([*command, *feel], cwd=place, check=True)
        (figure,) = Path(place).rglob("*.feel.png")
        shutil.copy(figure, folder / "feel.png")


def listening(
    browser: webdriver.Chrome, folder: Path, looks: tuple[tuple[int, str], ...]
) -> None:
    """The page that listens, ready, and listening to the browser's own false
    microphone, which beeps."""
    with tempfile.TemporaryDirectory() as place:
        write_listening_site(Path(place))
        with static_site(place) as url, false_microphone() as listener:
            listener.get(f"{url}?threshold=-45")
            button = listener.find_element(By.ID, "listen")
            wait(button.is_enabled)
            pictures(listener, folder, "listen-ready", looks)
            button.click()
            time.sleep(6)
            pictures(listener, folder, "listen", looks)


@contextlib.contextmanager
def static_site(folder: str) -> Iterator[str]:
    """Serve the files of a folder; yields the address."""
    serve = functools.partial(http.server.SimpleHTTPRequestHandler, directory=folder)
    with http.server.ThreadingHTTPServer(("127.0.0.1", 0), serve) as server:
        threading.Thread(target=server.serve_forever, daemon=True).start()
        yield f"http://127.0.0.1:{server.server_port}/index.html"
        server.shutdown()


def false_microphone() -> contextlib.AbstractContextManager[webdriver.Chrome]:
    """Start a browser that allows the page its microphone, which is a beep a second."""
    return chromium("use-fake-ui-for-media-stream", "use-fake-device-for-media-stream")


def trying(
    browser: webdriver.Chrome, folder: Path, looks: tuple[tuple[int, str], ...]
) -> None:
    """The page of `try` before anybody listens, without a microphone, and while it
    listens."""
    with tactophone("try", "--no-open") as url:
        browser.get(url)
        wait(lambda: browser.find_element(By.ID, "life").text.lower() == "waiting")
        pictures(browser, folder, "try-waiting", looks)
        browser.find_element(By.ID, "listen").click()
        wait(lambda: browser.find_element(By.ID, "listen-state").text)
        pictures(browser, folder, "try-no-microphone", looks)
        browser.get("about:blank")
        with false_microphone() as listener:
            listener.get(url)
            listener.find_element(By.ID, "listen").click()
            wait(lambda: listener.find_element(By.ID, "life").text.lower() == "live")
            time.sleep(5)
            pictures(listener, folder, "try-listening", looks)


def ends(
    browser: webdriver.Chrome, folder: Path, looks: tuple[tuple[int, str], ...]
) -> None:
    """The page of each end while nobody answers: what is checked before a call."""
    with tempfile.TemporaryDirectory() as place, contextlib.chdir(place):
        pair = [sys.executable, "-m", "tactophone", "pair"]
        made = subprocess.run(
            [*pair, "init", "--identity", "key"],
            check=True,
            capture_output=True,
            text=True,
        )
        # The line for the other machine ends with this one's fingerprint.
        fingerprint = made.stdout.split()[-1]
        trust = [*pair, "trust", "desk", fingerprint, "--identity", "key"]
        subprocess.run(trust, check=True)
        own = ("--set", "link.identity=key", "--dashboard")
        robot = ("send", "--source", "finger", "--peer", "127.0.0.1", *own)
        operator = ("receive", "--actuator", "none", *own)
        for name, words in (("robot", robot), ("operator", operator)):
            with tactophone(*words, "--name", f"pictures-{name}") as url:
                browser.get(url)
                panel = browser.find_element(By.ID, "check-panel")
                wait(panel.is_displayed)
                time.sleep(2)
                pictures(browser, folder, f"{name}-waiting", looks)


def recordings(
    browser: webdriver.Chrome, folder: Path, looks: tuple[tuple[int, str], ...]
) -> None:
    """The pages of a recording and of a recorded run, and what stands over one that has
    ended."""
    with tempfile.TemporaryDirectory() as place, contextlib.chdir(place):
        arguments = (
            "--objects",
            "0",
            "--takes",
            "wiggle",
            "--seconds",
            "6",
            "--gain",
            "-6",
        )
        subprocess.run(
            [
                sys.executable,
                "-m",
                "tactophone",
                "simulate",
                "dataset",
                "sound",
                *arguments,
            ],
            check=True,
        )
        run = (
            "loopback",
            "--source",
            "finger",
            "--actuator",
            "none",
            "--duration",
            "8",
            "--record",
            "run.mcap",
        )
        subprocess.run(
            [sys.executable, "-m", "tactophone", *run, "--name", "pictures-run"],
            check=True,
        )
        sound = "sound/00-lava-stone/held/wiggle.flac"
        pages = (("feel", "feel", sound), ("replay", "replay", "run.mcap"))
        for name, *arguments in pages:
            with tactophone(*arguments, "--dashboard") as url:
                browser.get(url)
                wait(
                    lambda: browser.find_element(By.ID, "life").text.lower() == "replay"
                )
                time.sleep(4)
                pictures(browser, folder, name, looks)
    time.sleep(1)
    pictures(browser, folder, "ended", looks)


def set_up(
    browser: webdriver.Chrome, folder: Path, looks: tuple[tuple[int, str], ...]
) -> None:
    """The page of `setup`: the tips, a step, and the result."""
    with (
        tempfile.TemporaryDirectory() as place,
        contextlib.chdir(place),
        tactophone(
            "setup", "--source", "finger", "--seconds", "20", "--dashboard"
        ) as url,
    ):
        browser.get(url)
        tips = wait(lambda: browser.find_elements(By.CSS_SELECTOR, ".tip"))
        pictures(browser, folder, "setup-tip", looks)
        tips[1].click()
        wait(lambda: browser.find_element(By.ID, "ring").is_displayed(), 60)
        pictures(browser, folder, "setup-step", looks)
        wait(lambda: browser.find_element(By.ID, "result-panel").is_displayed(), 300)
        pictures(browser, folder, "setup-result", looks)


def wait(done: Callable[[], Any], seconds: float = 60) -> Any:
    """Return what ``done`` returns once it is true."""
    until = time.monotonic() + seconds
    while not (found := done()) and time.monotonic() < until:
        time.sleep(0.1)
    return found


PARTS = {
    "dashboard": dashboard,
    "stone_box": stone_box,
    "felt": felt,
    "listening": listening,
    "trying": trying,
    "ends": ends,
    "recordings": recordings,
    "set_up": set_up,
}
"""The pages, by name."""

IN_DOCS = ("dashboard", "stone_box", "felt")
"""Those that the docs show."""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path, help="where the pictures are written")
    parser.add_argument(
        "--all",
        action="store_true",
        help="every screen in every size and theme, not only those in the docs",
    )
    parser.add_argument(
        "--part",
        action="append",
        choices=list(PARTS),
        help="only this page; repeatable",
    )
    args = parser.parse_args()
    folder = args.folder.absolute()
    folder.mkdir(parents=True, exist_ok=True)
    looks = ALL if args.all else DOCS
    names = args.part or (PARTS if args.all else IN_DOCS)
    with chromium("hide-scrollbars") as browser:
        browser.set_window_size(1280, 900)
        for name in names:
            PARTS[name](browser, folder, looks)


if __name__ == "__main__":
    main()
