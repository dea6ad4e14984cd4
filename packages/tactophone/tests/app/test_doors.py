"""All doors lead to one detector: what it takes a sound for does not depend on who
asks."""

import os
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import soundfile

import tactophone
from tactophone.app.recordings import open_recording_for
from tactophone.app.tables import classify
from tactophone.core.settings import Settings, change
from tactophone.core.types import (
    AlwaysOpen,
    AudioBlock,
    ContactRule,
    FloatArray,
    PipelineStep,
    Prediction,
    Touch,
)
from tactophone.signal.perception.detector import TouchDetector
from tactophone.signal.perception.opening import (
    DetectorOptions,
    open_detector,
    options_from,
)
from tactophone.signal.pipeline import Hand, open_pipeline, open_pipeline_for
from tactophone_lab.simulation.catalogue import find
from tactophone_lab.simulation.motion import single
from tactophone_lab.simulation.source import SimulatedFinger
from tactophone_lab.simulation.strokes import take_moves
from tactophone_lab.simulation.takes import TAKES
from tests.sounds import blocks

RATE = 48_000
SECONDS = 6
PACKET = 240


def touches() -> tuple[FloatArray, FloatArray]:
    """Return contact and air: silence for a second, then touches of 0.6 s."""
    random = np.random.default_rng(0)
    size = RATE * SECONDS
    time = np.arange(size) / RATE
    loud = (time % 1.0 > 0.4) & (time >= 1)
    contact, air = (
        random.normal(0, level, size) * loud + random.normal(0, 1e-4, size)
        for level in (0.05, 0.004)
    )
    return contact.astype(np.float32), air.astype(np.float32)


def hum() -> FloatArray:
    time = np.arange(RATE * SECONDS) / RATE
    wave = 0.5 * np.sin(2 * np.pi * 50 * time) + 0.3 * np.sin(2 * np.pi * 150 * time)
    return wave.astype(np.float32)


def sounds() -> dict[str, FloatArray]:
    contact, air = touches()
    pairs = {
        "good": (contact, air),
        "contact clipped": (np.clip(60 * contact, -1, 1), air),
        "air dead": (contact, 0 * air),
        "both the same": (contact, contact),
        "contact in hum": (0.02 * contact + hum(), 0.02 * air),
    }
    return {name: np.stack(pair, axis=1) for name, pair in pairs.items()}


class Given(AlwaysOpen):
    """A source of the user's own."""

    sample_rate = RATE

    def __init__(self, samples: FloatArray) -> None:
        self._samples, self.channels = samples, samples.shape[1]

    def __iter__(self) -> Iterator[AudioBlock]:
        yield from blocks(self._samples, PACKET)


def predictions(steps: Iterator[PipelineStep]) -> list[Prediction]:
    return [prediction for step in steps for prediction in step.predictions]


def live_doors(samples: FloatArray) -> dict[str, list[Prediction]]:
    channels = samples.shape[1]
    receive = open_pipeline_for(Settings(), channels=channels)
    python = open_pipeline(sample_rate=RATE, channels=channels)
    hand = Hand([open_pipeline_for(Settings(), channels=channels)], channels=[channels])
    robot = open_pipeline_for(Settings(), channels=channels).detector
    return {
        "receive": predictions(map(receive.push, blocks(samples, PACKET))),
        "open_pipeline": predictions(map(python.push, blocks(samples, PACKET))),
        "open_live": predictions(iter(tactophone.open_live(Given(samples)))),
        "the operator's hand": predictions(
            step for block in blocks(samples, PACKET) for step in hand.push(block)
        ),
        "send --send-predictions": [
            prediction
            for block in blocks(samples, PACKET)
            for prediction in robot.push(block)
        ],
    }


def recorded_doors(path: Path) -> dict[str, list[Prediction]]:
    return {
        "open_recording": predictions(tactophone.open_recording(path).steps()),
        "feel": predictions(open_recording_for(path, Settings()).steps()),
        "classify": list(classify(path).predictions),
    }


def agree(doors: dict[str, list[Prediction]]) -> None:
    """Assert that all doors give the same predictions, in every field."""
    (first, expected), *others = doors.items()
    assert expected
    for door, found in others:
        assert found == expected, f"{door} differs from {first}"


@pytest.mark.slow
@pytest.mark.parametrize("name", sounds())
def test_every_live_door_takes_a_sound_for_the_same(name: str) -> None:
    agree(live_doors(sounds()[name]))


@pytest.mark.slow
@pytest.mark.parametrize("name", sounds())
def test_every_recorded_door_takes_a_sound_for_the_same(
    name: str, tmp_path: Path
) -> None:
    soundfile.write(tmp_path / "a.wav", sounds()[name], RATE, subtype="FLOAT")
    agree(recorded_doors(tmp_path / "a.wav"))


@pytest.mark.slow
@pytest.mark.parametrize("name", sounds())
def test_a_recording_is_taken_for_what_a_live_run_takes_it_for(
    name: str, tmp_path: Path
) -> None:
    samples = sounds()[name]
    soundfile.write(tmp_path / "a.wav", samples, RATE, subtype="FLOAT")
    live = open_pipeline_for(Settings(), channels=2)
    heard, recorded = (
        share_of_contact(found)
        for found in (
            predictions(map(live.push, blocks(samples, PACKET))),
            predictions(tactophone.open_recording(tmp_path / "a.wav").steps()),
        )
    )
    if name == "contact in hum":
        # A recording is read before it is played, so its hum is subtracted; live it is
        # a fault of the microphone, and nothing is rendered.
        assert heard == 0
        assert recorded > 0.3
    else:
        assert recorded == pytest.approx(heard, abs=0.05)


def share_of_contact(found: list[Prediction]) -> float:
    """Return the share of contact once every fault has been found."""
    return float(
        np.mean([each.touch is not Touch.NONE for each in found if each.end > 3])
    )


@pytest.mark.slow
def test_every_door_takes_the_simulated_finger_for_the_same(tmp_path: Path) -> None:
    stone = single(find("lava stone"))
    random = np.random.default_rng(1)
    moves = take_moves(TAKES[1], stone.placed[0], duration=4.0, rng=random)
    finger = SimulatedFinger(stone, moves, seed=1, duration=4.0)
    samples = finger.render(4 * RATE).samples
    soundfile.write(tmp_path / "a.wav", samples, RATE, subtype="FLOAT")
    agree(live_doors(samples))
    agree(recorded_doors(tmp_path / "a.wav"))


@pytest.mark.slow
@pytest.mark.skipif(
    "TACTOPHONE_RECORDINGS" not in os.environ,
    reason="TACTOPHONE_RECORDINGS names a folder of real recordings",
)
@pytest.mark.parametrize(
    "file",
    [
        "lmt/G3CeramicTile_01.flac",
        "lmt/G7FineFoamVersion1_01.flac",
        "gripper/box.flac",
        "gripper/cable2.flac",
    ],
)
def test_every_door_takes_a_real_recording_for_the_same(file: str) -> None:
    path = Path(os.environ["TACTOPHONE_RECORDINGS"], file)
    agree(recorded_doors(path))
    agree(live_doors(at_live_rate(path)))


def at_live_rate(path: Path) -> FloatArray:
    """Return the first 6 s of a recording of one channel at the rate of live sound."""
    samples, rate = soundfile.read(path, dtype="float32")
    times = np.arange(SECONDS * RATE) / RATE
    times = times[times < len(samples) / rate]
    between = np.interp(times, np.arange(len(samples)) / rate, samples)
    return between.astype(np.float32)[:, None]


def test_settings_say_all_that_decides(tmp_path: Path) -> None:
    changes = {
        "detector.model": "rubber",
        "capture.tip": "rubber",
        "detector.contact": "level",
        "detector.threshold_dbfs": "-30",
        "detector.margin_db": "7",
        "detector.check_microphones": "false",
        "detector.events": "true",
    }
    settings = change(Settings(), [f"{key}={value}" for key, value in changes.items()])
    assert options_from(settings, channels=2) == DetectorOptions(
        sample_rate=RATE,
        channels=2,
        model="rubber",
        tip="rubber",
        contact="level",
        threshold_dbfs=-30.0,
        margin_db=7.0,
        check_microphones=False,
        events=True,
    )
    unset = options_from(Settings(), channels=2)
    assert unset == DetectorOptions(sample_rate=RATE, channels=2)
    assert replace(unset, channels=1) == options_from(Settings(), channels=1)


def opened(contact: ContactRule) -> TouchDetector:
    detector = open_detector(
        DetectorOptions(
            sample_rate=RATE, channels=2, contact=contact, check_microphones=False
        )
    )
    assert isinstance(detector, TouchDetector)
    return detector


def test_what_decides_on_contact_is_what_was_asked_for() -> None:
    by_bands = opened("bands").gate
    assert by_bands
    assert by_bands.levels.settings[2]
    by_level = opened("level").gate
    assert by_level
    assert not by_level.levels.settings[2]
    assert opened("window").gate is None
