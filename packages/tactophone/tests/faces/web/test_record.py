"""A log begun and ended on the page."""

from collections.abc import Iterator
from pathlib import Path

import pytest
from selenium import webdriver
from selenium.webdriver.common.by import By

from tactophone.app.runs import PageRecorder
from tactophone.faces.web.dashboard import RecordRequest, parse_request
from tactophone.faces.web.server import Page, watch
from tactophone.live.log.mcap import read_log
from tactophone.live.telemetry.layout import RunState
from tests.browser import text, wait
from tests.faces.web.running import Run


@pytest.fixture
def recorded_page(run: Run, tmp_path: Path) -> Iterator[Page]:
    with (
        PageRecorder(run.telemetry.name, tmp_path) as recorder,
        watch(run.telemetry.name, recorder=recorder.page) as page,
    ):
        yield page


@pytest.mark.realtime
def test_the_button_begins_and_ends_a_log(
    browser: webdriver.Chrome, recorded_page: Page, tmp_path: Path
) -> None:
    pytest.importorskip("mcap")
    browser.get(recorded_page.url)
    wait(browser, lambda: browser.find_elements(By.ID, "record"))
    browser.find_element(By.ID, "record").click()
    assert text(browser, "recording") == "Starting to record."
    wait(browser, lambda: "Recording to" in text(browser, "recording"), 20)
    browser.refresh()  # a page that comes later sees it too, with its clock
    wait(browser, lambda: text(browser, "record") >= "Rec 0:01")
    browser.find_element(By.ID, "record").click()
    wait(browser, lambda: "Saved" in text(browser, "recording"), 20)
    (path,) = tmp_path.glob("*.mcap")
    said = text(browser, "recording")
    assert path.name in said
    assert "kB" in said
    assert f"tactophone replay {path.name}" in said
    entries = list(read_log(path))
    assert len(entries) > 50
    browser.find_element(By.ID, "record").click()
    wait(browser, lambda: "Recording to" in text(browser, "recording"), 20)
    # The page's server ends before the log, which takes a while; the page must not ask
    # for it meanwhile.
    browser.get("about:blank")


@pytest.mark.realtime
def test_a_log_left_open_is_ended_with_the_run(run: Run, tmp_path: Path) -> None:
    pytest.importorskip("mcap")
    with PageRecorder(run.telemetry.name, tmp_path) as recorder:
        recorder.page.send(True)
        assert recorder.page.poll(20)
        assert recorder.page.recv()["recording"]["folder"] == str(tmp_path)
    (path,) = tmp_path.glob("*.mcap")
    assert list(read_log(path))


@pytest.mark.realtime
def test_a_folder_that_cannot_be_written_is_a_reason(run: Run, tmp_path: Path) -> None:
    pytest.importorskip("mcap")
    with PageRecorder(run.telemetry.name, tmp_path / "none") as recorder:
        recorder.page.send(True)
        assert recorder.page.poll(20)
        assert recorder.page.recv()["recording"]["phase"] == "starting"
        assert recorder.page.poll(20)
        assert "cannot write" in recorder.page.recv()["recording"]["trouble"]


@pytest.mark.realtime
def test_a_second_press_ends_what_only_starts(run: Run, tmp_path: Path) -> None:
    pytest.importorskip("mcap")
    with PageRecorder(run.telemetry.name, tmp_path) as recorder:
        recorder.page.send(True)
        recorder.page.send(False)
        answers = [
            recorder.page.recv()["recording"]
            for _ in range(4)
            if recorder.page.poll(20)
        ]
    assert [answer["phase"] for answer in answers] == [
        "starting",
        "on",
        "ending",
        "saved",
    ]
    saved = answers[-1]
    assert saved["bytes"] == (tmp_path / saved["file"]).stat().st_size
    assert not saved["trouble"]


@pytest.mark.realtime
def test_a_run_that_is_not_recorded_has_no_button(
    browser: webdriver.Chrome, page: Page
) -> None:
    browser.get(page.url)
    wait(browser, lambda: text(browser, "life") == "live")
    assert browser.find_elements(By.ID, "record") == []


def test_only_a_page_on_the_machine_may_record() -> None:
    asked = '{"action": "record", "value": true}'
    assert "only a page on the run's own machine" in str(
        parse_request(asked, RunState(), local=False)
    )
    assert parse_request(asked, RunState()) == RecordRequest(begin=True)
    assert parse_request(
        '{"action": "record", "value": 1}', RunState()
    ) == RecordRequest(begin=False)
