"""`tactophone setup` on a page: a simulated finger, the tip chosen and the end
confirmed by buttons."""

import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
from selenium import webdriver
from selenium.webdriver.common.by import By

from tactophone.signal.perception.model_file import read_model
from tests.accessibility import (
    SIZES,
    needs_axe,
    outside,
    reached_by_tab,
    serious_faults,
)
from tests.browser import resize, text, wait

pytestmark = pytest.mark.realtime

SETUP = [
    "setup",
    "--source",
    "finger",
    "--set",
    "simulation.gain_db=-30",
    "--set",
    "simulation.air_gain_db=-30",
    "--seconds",
    "2",
    "--dashboard",
]


@pytest.fixture
def setup(tmp_path: Path) -> Iterator[subprocess.Popen[str]]:
    command = [
        sys.executable,
        "-m",
        "tactophone",
        *SETUP,
        "--out",
        str(tmp_path / "own.onnx"),
    ]
    process = subprocess.Popen(
        command,
        stdin=subprocess.DEVNULL,
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
    )
    yield process
    process.kill()
    process.communicate()


def address(process: subprocess.Popen[str]) -> str:
    assert process.stdout is not None
    for line in process.stdout:
        if found := re.match(r"page: (\S+)", line):
            return found[1]
    raise AssertionError("no address")


def press(browser: webdriver.Chrome, name: str) -> None:
    wait(
        browser,
        lambda: browser.find_elements(By.CSS_SELECTOR, f'button[value="{name}"]'),
        60,
    )
    browser.find_element(By.CSS_SELECTOR, f'button[value="{name}"]').click()


def test_a_finger_is_set_up_by_buttons_alone(
    browser: webdriver.Chrome, setup: subprocess.Popen[str], tmp_path: Path
) -> None:
    browser.get(address(setup))
    wait(browser, lambda: "Ink it" in text(browser, "instruction"), 30)
    for width in SIZES:
        resize(browser, width, 844)
        assert outside(browser) <= 0
    count, reached = reached_by_tab(browser)
    assert len(reached) == count
    press(browser, "stylus")
    press(browser, "done")
    assert setup.wait(60) == 0
    assert read_model(tmp_path / "own.onnx").card.tip == "stylus"


@needs_axe
def test_axe_finds_nothing_serious(
    browser: webdriver.Chrome, setup: subprocess.Popen[str]
) -> None:
    browser.get(address(setup))
    wait(
        browser,
        lambda: text(browser, "life") == "connected" and text(browser, "picture"),
        30,
    )
    assert serious_faults(browser) == []
    press(browser, "stylus")
    wait(browser, lambda: "balanced" in text(browser, "objects"), 60)
    assert serious_faults(browser) == []
