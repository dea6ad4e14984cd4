"""A viewer's feed: nothing is sent twice or left out, whatever the pauses."""

import sys
from uuid import uuid4

import numpy as np
import pytest

from tactophone.core.texture_bands import band_edges
from tactophone.core.types import (
    AudioBlock,
    HapticCommand,
    PipelineStep,
    Prediction,
    Touch,
)
from tactophone.faces.web.feed import Feed, WatchedRun
from tactophone.live.telemetry.layout import FingerState, Request, RunState
from tactophone.live.telemetry.memory import PREFIX, folder
from tactophone.live.telemetry.writer import Telemetry
from tests.faces.web.test_message import BUCKET, parse

RATE = 48_000
NAME = f"test-feed-{uuid4().hex[:8]}"
"""Of the run: another in each process, as tests may run side by side."""


def publish(
    telemetry: Telemetry, sound: np.ndarray, start: int, now: float = 1e9
) -> None:
    prediction = Prediction((0, 0, 1), Touch.ROUGH, 1.0, -20.0, 0, 0)
    telemetry.publish(
        PipelineStep(AudioBlock(sound, RATE, start), (prediction,), ()), now=now
    )


@pytest.mark.parametrize("size", [17, 480, 509, 4800])
def test_the_envelope_is_the_same_however_the_sound_came(size: int) -> None:
    rng = np.random.default_rng(3)
    sound = rng.uniform(-1, 1, (40_000, 2)).astype(np.float32)
    rows = []
    with Telemetry(NAME) as telemetry:
        telemetry.update(RunState(), now=1e9)
        feed = Feed(WatchedRun(NAME))
        for start in range(0, len(sound), size):
            publish(telemetry, sound[start : start + size], start)
            if start // size % 3 != 1:  # now and then a viewer is late
                rows.append(_absolute(feed.message()))
    seen = np.concatenate(rows)
    count = len(seen)
    assert count >= (len(sound) - 2 * size) // BUCKET
    np.testing.assert_allclose(
        seen[:, 0], (1 + np.arange(count)) * BUCKET / RATE, atol=1e-4
    )
    buckets = sound[: count * BUCKET, 0].reshape(count, BUCKET)
    np.testing.assert_array_equal(seen[:, 1], buckets.min(axis=1))


def _absolute(message: bytes) -> np.ndarray:
    header, tables = parse(message)
    table = tables["sound"].astype(np.float64)
    return np.column_stack([table[:, 0] + header["origin"], table[:, 1:]])


def test_a_viewer_that_paused_gets_the_newest_and_no_torn_bucket() -> None:
    with Telemetry(NAME) as telemetry:
        telemetry.update(RunState(), now=1e9)
        feed = Feed(WatchedRun(NAME))
        publish(telemetry, np.zeros((700, 2), np.float32), 0)
        feed.message()
        for k in range(40):  # more than the ring holds
            publish(
                telemetry, np.full((10_000, 2), k / 100, np.float32), 700 + 10_000 * k
            )
        _, tables = parse(feed.message())
    assert tables["sound"][-1, 1] == np.float32(0.39)
    assert len(tables["steps"]) == 40


def test_a_run_that_restarts_is_found_and_sent_from_its_beginning() -> None:
    feed = Feed(WatchedRun(NAME))
    assert parse(feed.message())[0]["waiting_for"] == NAME
    with Telemetry(NAME) as telemetry:
        # The last heartbeat was long ago.
        telemetry.update(RunState(role="first"), now=0.0)
        for k in range(3):
            publish(telemetry, np.zeros((480, 2), np.float32), 480 * k, now=0.0)
        header, _ = parse(feed.message())
        assert (header["state"]["role"], header["alive"]) == ("first", False)
    with Telemetry(NAME) as telemetry:
        telemetry.update(RunState(role="second"), now=1e9)
        publish(telemetry, np.ones((480, 2), np.float32), 0)
        header, tables = parse(feed.message())
    assert header["state"]["role"] == "second"
    assert len(tables["sound"]) == 1


def test_a_page_shows_one_finger_and_what_all_of_them_do() -> None:
    with Telemetry(NAME, fingers=2) as telemetry:
        fingers = (
            FingerState("thumb", profile="paper"),
            FingerState("index", profile="lra", armed=True),
        )
        telemetry.update(RunState(fingers=fingers), now=1e9)
        prediction = Prediction((0, 0, 1), Touch.ROUGH, 1.0, -20.0, 0, 0)
        block = AudioBlock(np.full((480, 2), 0.5, np.float32), RATE)
        step = PipelineStep(block, (prediction,), (HapticCommand(0.25, 60.0, 0.0),), 1)
        telemetry.publish(step, now=1e9)
        run = WatchedRun(NAME)
        header, tables = parse(Feed(run, finger=1).message())
        assert (header["state"]["profile"], header["state"]["armed"]) == ("lra", True)
        assert header["hand"] == [[0, 0.0], [2, 0.25]]
        assert len(tables["sound"]) == 1
        run.ask(Request("mute", finger=1))
        assert [request.finger for request in telemetry.requests()] == [1]


@pytest.mark.skipif(sys.platform != "linux", reason="only there it is found")
def test_a_page_that_is_opened_after_the_memory_lost_its_name_stops_the_run() -> None:
    """It waited for the run, and its stop reached nobody."""
    with Telemetry(NAME) as telemetry:
        telemetry.update(RunState(), now=1e9)
        (folder() / f"{PREFIX}{NAME}").unlink()
        run = WatchedRun(NAME)
        parse(Feed(run).message())
        run.ask(Request("stop"))
        assert [request.action for request in telemetry.requests()] == ["stop"]


def test_a_second_pass_brings_no_steps_of_the_first() -> None:
    sound = np.zeros((4800, 2), np.float32)
    with Telemetry(NAME) as telemetry:
        telemetry.update(RunState(), now=1e9)
        for start in (0, 4800, 9600, 0):  # the recording begins again
            publish(telemetry, sound, start)
        header, tables = parse(Feed(WatchedRun(NAME)).message())
    assert header["origin"] == pytest.approx(4800 / RATE)
    assert tables["steps"][:, 0].max() <= 1e-6
    # Nor sound, which would stand where this pass had not begun.
    for name in ("steps", "sound", "spectrum"):
        assert tables[name][:, 0].min() > -0.12, name


@pytest.mark.parametrize("size", [17, 480, 509, 4800])
def test_the_spectrogram_shows_a_tone_in_its_band_at_its_time(size: int) -> None:
    seconds = np.arange(48_000) / RATE
    tone = 0.1 * np.sin(2 * np.pi * 1000 * seconds) * (seconds >= 0.5)
    sound = np.column_stack([tone, 0 * tone]).astype(np.float32)
    rows = []
    with Telemetry(NAME) as telemetry:
        telemetry.update(RunState(), now=1e9)
        feed = Feed(WatchedRun(NAME))
        for start in range(0, len(sound), size):
            publish(telemetry, sound[start : start + size], start)
            if start // size % 3 != 1:  # now and then a viewer is late
                header, tables = parse(feed.message())
                columns = tables["spectrum"].astype(float)
                columns[:, 0] += header["origin"]
                rows.append(columns)
    seen = np.concatenate(rows)
    # Each column is the window of 32 ms that ends at its time; one comes every 20 ms.
    np.testing.assert_allclose(
        seen[:, 0], 0.032 + 0.02 * np.arange(len(seen)), atol=1e-4
    )
    assert len(seen) >= 46
    loudest = seen[:, 1:].argmax(axis=1)
    band = int(np.abs(band_edges()[1:-1] - 1000).argmin())
    assert set(loudest[seen[:, 0] > 0.51]) == {band}
    assert seen[seen[:, 0] < 0.5, 1:].max() == pytest.approx(-90)


def test_sound_that_was_missed_is_no_part_of_a_column() -> None:
    with Telemetry(NAME) as telemetry:
        telemetry.update(RunState(), now=1e9)
        feed = Feed(WatchedRun(NAME))
        loud = np.full((1500, 2), 0.5, np.float32)
        publish(telemetry, loud, 0)
        feed.message()
        for start in range(1500, 300_000, 5000):  # more than the ring holds
            publish(telemetry, np.zeros((5000, 2), np.float32), start)
        _, tables = parse(feed.message())
    assert tables["spectrum"][:, 1:].max() == pytest.approx(-90)


def test_a_finger_that_no_hand_has_stands_for_the_first_one() -> None:
    """A request that was granted for the first finger went to all of them."""
    with Telemetry(NAME, fingers=2) as telemetry:
        telemetry.update(RunState(), now=1e9)
        run = WatchedRun(NAME)
        run.snapshot(finger=9)
        run.ask(Request("output_level", 1.0, finger=9))
        run.ask(Request("stop"))
        asked = [(request.action, request.finger) for request in telemetry.requests()]
    assert asked == [("output_level", 0), ("stop", -1)]


def test_no_viewer_takes_the_place_of_anothers_lowering() -> None:
    with Telemetry(NAME) as telemetry:
        telemetry.update(RunState(), now=1e9)
        run = WatchedRun(NAME)
        run.snapshot()
        for value in (0.4, 0.1, 0.5):
            run.ask(Request("lower_ceiling", value, finger=0))
        (asked,) = telemetry.requests()
    assert asked.value == 0.1
