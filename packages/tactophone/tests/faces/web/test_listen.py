"""The microphone of a page: what the server passes on and what it refuses."""

import asyncio
import json
import socket
import struct
import time
from collections.abc import Iterator
from contextlib import suppress
from dataclasses import replace
from multiprocessing import Pipe
from multiprocessing.connection import Connection
from pathlib import Path
from urllib.parse import urlsplit

import aiohttp
import numpy as np
import pytest
import soundfile
from selenium.webdriver.common.by import By

from tactophone.faces.web.devices import FINGERTIPS
from tactophone.faces.web.server import Page, watch
from tactophone.faces.web.views import (
    FLOOD,
    OTHER_VERSION,
    OWN_PLACES,
    PAGE_VIEWERS,
    TAKEN,
    TOO_MANY,
)
from tests.browser import start_chromium, text, wait
from tests.faces.web.running import Run
from tests.faces.web.test_message import parse
from tests.live.runtime.live_system import eventually

pytestmark = pytest.mark.realtime


@pytest.fixture
def sound() -> Connection:
    return _PIPE[0]


_PIPE = Pipe(duplex=False)


@pytest.fixture
def page(run: Run) -> Iterator[Page]:
    with watch(run.telemetry.name, microphone=_PIPE[1]) as page:
        yield page


def message(start: int, samples: np.ndarray) -> bytes:
    return struct.pack("<I", start) + samples.astype("<f4").tobytes()


async def _open(
    session: aiohttp.ClientSession, page: Page, path: str
) -> aiohttp.ClientWebSocketResponse:
    return await session.ws_connect(
        page.url + path, origin=page.url[: page.url.rindex("/", 0, -1)]
    )


async def _reason(view: aiohttp.ClientWebSocketResponse) -> tuple[int, str]:
    while True:
        received = await view.receive(timeout=5)
        if received.type is aiohttp.WSMsgType.CLOSE:
            return received.data, received.extra
        assert received.type is not aiohttp.WSMsgType.CLOSED


@pytest.mark.parametrize("path", ["live", "feel", "listen"])
def test_a_flood_of_pings_is_closed(page: Page, run: Run, path: str) -> None:
    async def flood() -> tuple[int, str]:
        async with aiohttp.ClientSession() as session:
            view = await _open(session, page, f"{path}?v=1")
            with suppress(ConnectionError):
                for _ in range(3000):
                    await view.ping(b"p" * 125)
            return await _reason(view)

    assert asyncio.run(flood())[0] == FLOOD
    assert run.state.armed


def test_sound_is_passed_on_as_it_is(page: Page, sound: Connection) -> None:
    samples = np.linspace(-1, 1, 256, dtype=np.float32)

    async def speak() -> None:
        async with aiohttp.ClientSession() as session:
            view = await _open(session, page, "listen?v=1")
            await view.send_bytes(message(512, samples))
            await asyncio.sleep(0.3)

    asyncio.run(speak())
    assert sound.recv_bytes() == message(512, samples)
    assert not sound.poll(0.1)


@pytest.mark.parametrize(
    "sent",
    [
        '{"action": "arm"}',
        '{"action": "ceiling", "value": 1}',
        b"",
        b"12345",
        bytes(4001),
    ],
)
def test_whatever_is_no_sound_ends_the_connection_and_reaches_nobody(
    page: Page, run: Run, sound: Connection, sent: str | bytes
) -> None:
    """A source can never arm, raise or unmute: its socket has no way to make a
    request."""

    async def speak() -> tuple[int, str]:
        async with aiohttp.ClientSession() as session:
            view = await _open(session, page, "listen?v=1")
            await (
                view.send_str(sent) if isinstance(sent, str) else view.send_bytes(sent)
            )
            return await _reason(view)

    before = run.state
    code, reason = asyncio.run(speak())
    assert (code, "not a message of sound" in reason) == (1003, True)
    assert run.state == before
    assert not sound.poll(0.1)


def test_a_second_page_and_a_flood_are_sent_away_with_a_reason(
    page: Page, sound: Connection
) -> None:
    async def speak() -> list[tuple[int, str]]:
        async with aiohttp.ClientSession() as session:
            first, second = [await _open(session, page, "listen?v=1") for _ in range(2)]
            found = [await _reason(second)]
            for k in range(200):
                await first.send_bytes(message(960 * k, np.zeros(960)))
            return [*found, await _reason(first)]

    taken, flood = asyncio.run(speak())
    assert (taken[0], flood[0]) == (TAKEN, FLOOD)
    assert "another page is the microphone" in taken[1]
    assert "sends too much" in flood[1]
    while sound.poll(0.1):
        sound.recv_bytes()


@pytest.mark.parametrize("path", ["live", "feel", "listen"])
def test_a_page_of_another_version_is_asked_to_reload(page: Page, path: str) -> None:
    async def look() -> tuple[int, str]:
        async with aiohttp.ClientSession() as session:
            return await _reason(await _open(session, page, f"{path}?v=0"))

    code, reason = asyncio.run(look())
    assert (code, reason) == (
        OTHER_VERSION,
        "this page comes from another version: reload it; if that does not help, "
        "tactophone was updated: restart the run",
    )


@pytest.mark.parametrize(
    ("path", "most"), [("live", PAGE_VIEWERS), ("feel", FINGERTIPS)]
)
def test_of_fifty_pages_those_too_many_are_sent_away_with_a_reason(
    page: Page, path: str, most: int
) -> None:
    async def look() -> list[tuple[int, str]]:
        async with aiohttp.ClientSession() as session:
            views = [await _open(session, page, f"{path}?v=1") for _ in range(50)]
            return [await _reason(view) for view in views[most:]]

    found = asyncio.run(look())
    assert set(found) == {(TOO_MANY, f"{most} pages are open already: close one")}
    assert len(found) == 50 - most


@pytest.mark.parametrize(
    ("path", "most"), [("live", PAGE_VIEWERS), ("feel", FINGERTIPS)]
)
def test_pages_on_the_network_leave_places_for_those_on_this_machine(
    page: Page, path: str, most: int
) -> None:
    """The operator's own page must be there to stop the run."""

    async def look() -> list[bool]:
        elsewhere = aiohttp.TCPConnector(local_addr=("127.0.0.2", 0), limit=0)
        async with (
            aiohttp.ClientSession(connector=elsewhere) as others,
            aiohttp.ClientSession() as own,
        ):
            views = [await _open(others, page, f"{path}?v=1") for _ in range(most)]
            reasons = [await _reason(view) for view in views[most - OWN_PLACES :]]
            last = await _open(own, page, f"{path}?v=1")
            with suppress(TimeoutError):
                await asyncio.wait_for(last.receive(), 0.2)
            return [last.closed, *(code == TOO_MANY for code, _ in reasons)]

    assert asyncio.run(look()) == [False, *[True] * OWN_PLACES]


@pytest.mark.usefixtures("sound")
def test_a_page_on_the_network_may_be_the_microphone(page: Page) -> None:
    """No place was left for a phone, as the last places are this machine's."""

    async def refused() -> bool:
        elsewhere = aiohttp.TCPConnector(local_addr=("127.0.0.2", 0))
        async with aiohttp.ClientSession(connector=elsewhere) as session:
            view = await _open(session, page, "listen?v=1")
            with suppress(TimeoutError):
                await asyncio.wait_for(view.receive(), 0.5)
            return view.closed

    assert not asyncio.run(refused())


def test_a_page_that_floods_with_requests_is_closed_and_the_run_goes_on(
    page: Page, run: Run
) -> None:
    async def flood() -> tuple[int, str]:
        async with aiohttp.ClientSession() as session:
            view = await _open(session, page, "live?v=1")
            for _ in range(3000):
                await view.send_str('{"action": "output_level", "value": 0.5}')
            return await _reason(view)

    assert asyncio.run(flood())[0] == FLOOD
    assert run.state.armed


def test_what_pages_elsewhere_ask_waits_in_turn_and_keeps_no_stop_from_the_run(
    page: Page, run: Run
) -> None:
    """Each under the limit of a flood, they kept the operator's Stop waiting."""

    async def refusals(view: aiohttp.ClientWebSocketResponse) -> int:
        count = 0
        with suppress(TimeoutError):
            async with asyncio.timeout(2):
                async for received in view:
                    count += received.type is aiohttp.WSMsgType.TEXT
        return count

    async def ask() -> tuple[int, float]:
        elsewhere = aiohttp.TCPConnector(local_addr=("127.0.0.2", 0), limit=0)
        async with (
            aiohttp.ClientSession(connector=elsewhere) as others,
            aiohttp.ClientSession() as own,
        ):
            views = [await _open(others, page, "live?v=1") for _ in range(3)]
            stop = await _open(own, page, "live?v=1")
            for _ in range(400):
                for view in views:
                    await view.send_str('{"action": "arm"}')
            found = [asyncio.create_task(refusals(view)) for view in views]
            begun = time.monotonic()
            await stop.send_str('{"action": "stop"}')
            while run.state.armed and time.monotonic() - begun < 20:
                await asyncio.sleep(0.01)
            took = time.monotonic() - begun
            return sum([await each for each in found]), took

    answered, took = asyncio.run(ask())
    assert answered < 600  # of 1,200
    assert took < 1.5


def test_a_late_arming_is_refused_and_one_that_saw_the_stop_is_not(
    page: Page, run: Run
) -> None:
    async def press(view: aiohttp.ClientWebSocketResponse) -> list[str]:
        """Arm as a page does that saw the run before the stop, then as one that sees
        it now."""
        refused: list[str] = []
        seen = None
        async for received in view:
            if received.type is aiohttp.WSMsgType.TEXT:
                refused += [json.loads(received.data).get("refused", "")]
                continue
            silenced = parse(received.data)[0]["silenced"]
            await view.send_str("ok")
            if seen is None:
                seen = silenced
                await view.send_str('{"action": "stop"}')
            elif not run.state.armed and silenced != seen:
                asked = silenced if any(refused) else seen
                await view.send_str(json.dumps({"action": "arm", "silenced": asked}))
                if any(refused):
                    return refused
        return refused

    async def ask() -> list[str]:
        async with aiohttp.ClientSession() as session:
            return await asyncio.wait_for(press(await _open(session, page, "live")), 20)

    assert any("press again" in reason for reason in asyncio.run(ask()))
    eventually(lambda: run.state.armed)


def test_files_are_sent_elsewhere_in_turn(page: Page) -> None:
    """However many requests a browser that is none sends at once."""
    place = urlsplit(page.url)
    asked = f"GET {place.path}static/palette.css HTTP/1.1\r\nHost: {place.netloc}\r\n"
    with socket.create_connection(
        (place.hostname or "", place.port or 0), source_address=("127.0.0.2", 0)
    ) as browser:
        browser.settimeout(20)
        browser.sendall(f"{asked}\r\n".encode() * 400)
        answers = browser.recv(1 << 20)  # once the server has started
        browser.settimeout(0.1)
        until = time.monotonic() + 2
        while time.monotonic() < until:
            with suppress(TimeoutError):
                answers += browser.recv(1 << 20)
    assert 0 < answers.count(b"HTTP/1.1 200") < 300


@pytest.mark.parametrize("rate", [8000, 44_100, 48_000])
def test_a_microphone_of_any_rate_is_heard_at_48_khz(
    page: Page, run: Run, sound: Connection, tmp_path: Path, rate: int
) -> None:
    time = np.arange(20 * 48_000) / 48_000
    tone = tmp_path / "tone.wav"
    soundfile.write(tone, 0.5 * np.sin(2 * np.pi * 1000 * time), 48_000)
    run.state = replace(run.state, source="browser")
    browser = start_chromium(
        "--use-fake-ui-for-media-stream",
        "--use-fake-device-for-media-stream",
        f"--use-file-for-fake-audio-capture={tone}",
    )
    # As in Firefox: a context has the rate of its device, and refuses another.
    script = (
        "const Real = AudioContext; window.AudioContext = function (options) {"
        " if (options?.sampleRate) throw new DOMException('another sample rate');"
        f" return new Real({{ ...options, sampleRate: {rate} }}); }}"
    )
    try:
        browser.execute_cdp_cmd(
            "Page.addScriptToEvaluateOnNewDocument", {"source": script}
        )
        browser.get(f"{page.url}try")
        wait(browser, lambda: text(browser, "life") == "live")
        browser.find_element(By.ID, "listen").click()
        wait(browser, lambda: sound.poll() or "cannot" in text(browser, "listen-state"))
        assert "is live" in text(browser, "listen-state")
        heard = []
        while sum(map(len, heard)) < 48_000:
            assert sound.poll(5)
            heard.append(np.frombuffer(sound.recv_bytes(), "<f4", offset=4))
    finally:
        browser.quit()
        while sound.poll(0.2):
            sound.recv_bytes()
    spectrum = np.abs(np.fft.rfft(np.concatenate(heard)[-32_768:] * np.hanning(32_768)))
    assert np.argmax(spectrum) * 48_000 / 32_768 == pytest.approx(1000, abs=3)


def test_a_second_press_while_the_browser_asks_opens_no_second_microphone(
    page: Page, run: Run, sound: Connection
) -> None:
    """The first one went on sending for ever, and the page said that it was off."""
    run.state = replace(run.state, source="browser")
    browser = start_chromium(
        "--use-fake-ui-for-media-stream", "--use-fake-device-for-media-stream"
    )
    script = (
        "window.tracks = []; const devices = navigator.mediaDevices;"
        "const ask = devices.getUserMedia.bind(devices);"
        "devices.getUserMedia = async (wanted) => {"
        " await new Promise((done) => setTimeout(done, 500));"
        " const stream = await ask(wanted);"
        " window.tracks.push(...stream.getTracks()); return stream; }"
    )
    tracks = "return window.tracks.map((track) => track.readyState)"
    try:
        browser.get(f"{page.url}try")
        wait(browser, lambda: text(browser, "life") == "live")
        browser.execute_script(script)
        button = browser.find_element(By.ID, "listen")
        button.click()
        time.sleep(0.2)
        button.click()
        wait(browser, lambda: "is live" in text(browser, "listen-state"))
        assert browser.execute_script(tracks) == ["live"]
        button.click()
        wait(browser, lambda: button.text == "Use this microphone")
        assert browser.execute_script(tracks) == ["ended"]
    finally:
        browser.quit()
        while sound.poll(0.2):
            sound.recv_bytes()


@pytest.mark.parametrize(
    ("flags", "setting", "words"),
    [
        (("--use-fake-device-for-media-stream",), "denied", "refused the microphone"),
        ((), "granted", "has no microphone"),
    ],
)
def test_a_refused_or_missing_microphone_is_said_with_what_to_do(
    page: Page, run: Run, flags: tuple[str, ...], setting: str, words: str
) -> None:
    run.state = replace(run.state, source="browser")
    browser = start_chromium(*flags)
    try:
        permission = {"permission": {"name": "microphone"}, "setting": setting}
        browser.execute_cdp_cmd("Browser.setPermission", permission)
        browser.get(f"{page.url}try")
        wait(browser, lambda: text(browser, "life") == "live")
        button = browser.find_element(By.ID, "listen")
        button.click()
        wait(browser, lambda: words in text(browser, "listen-state"))
        assert "try again" in text(browser, "listen-state")
        assert (button.text, button.get_attribute("aria-pressed")) == (
            "Use this microphone",
            "false",
        )
    finally:
        browser.quit()
