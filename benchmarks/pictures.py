"""Pictures of the pages: those in `docs/images`, or every screen in every size and
theme, to be looked at.

``python benchmarks/pictures.py FOLDER`` writes ``dashboard.png`` and ``stone-box.png``;
``--all`` writes each screen of each page at 390, 768 and 1280 px, light and dark.
Needs Debian's chromium and chromium-driver.
"""

import argparse
import base64
import contextlib
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path
from typing import Any

from selenium import webdriver
from selenium.webdriver.common.action_chains import ActionChains
from selenium.webdriver.common.by import By

from page import chromium, tactophone

DOCS = ((1280, "light"),)
ALL = tuple((width, theme) for width in (390, 768, 1280) for theme in ("light", "dark"))
ROUGH_STONES = (2, 3)
"""Of the game with seed 5."""


def picture(browser: webdriver.Chrome, path: Path, *, width: int, theme: str) -> None:
    """Write the whole page as it is now."""
    features = [{"name": "prefers-color-scheme", "value": theme}]
    browser.execute_cdp_cmd("Emulation.setEmulatedMedia", {"features": features})
    size = {
        "width": width,
        "height": 900,
        "deviceScaleFactor": 0.8,
        "mobile": width < 500,
    }
    browser.execute_cdp_cmd("Emulation.setDeviceMetricsOverride", size)
    time.sleep(0.8)
    shot = browser.execute_cdp_cmd(
        "Page.captureScreenshot", {"captureBeyondViewport": True, "format": "png"}
    )
    path.write_bytes(base64.b64decode(shot["data"]))


def pictures(
    browser: webdriver.Chrome,
    folder: Path,
    name: str,
    looks: tuple[tuple[int, str], ...],
) -> None:
    """Write the page in each size and theme."""
    for width, theme in looks:
        suffix = "" if looks is DOCS else f"-{width}-{theme}"
        picture(browser, folder / f"{name}{suffix}.png", width=width, theme=theme)


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
        time.sleep(15)
        until, in_a_row = time.monotonic() + 60, 0
        while in_a_row < 12 and time.monotonic() < until:  # within a rough touch
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
        tactophone("play", "--seed", "5", "--name", "pictures-box") as url,
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
    "recordings": recordings,
    "set_up": set_up,
}
"""The pages, by name; the docs show the first two."""


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
    names = args.part or (list(PARTS) if args.all else ["dashboard", "stone_box"])
    with chromium("hide-scrollbars") as browser:
        browser.set_window_size(1280, 900)
        for name in names:
            PARTS[name](browser, folder, looks)


if __name__ == "__main__":
    main()
