from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import soundfile

from tactophone import Touch
from tactophone.core.errors import DatasetError
from tactophone.core.recordings.values import Dataset
from tactophone.signal.perception.health import Reference
from tactophone_lab.datasets.checks import check
from tactophone_lab.datasets.open import open_dataset
from tactophone_lab.recording.protocol import Key, Stage
from tactophone_lab.recording.safe_writer import PART
from tactophone_lab.recording.take_recorder import RecordedObject, Recorder, SessionPlan
from tactophone_lab.simulation.catalogue import find
from tactophone_lab.simulation.faults import FaultSpan, FaultySource
from tactophone_lab.simulation.participant import SimulatedParticipant
from tactophone_lab.simulation.takes import TAKES

TARGET = RecordedObject(
    "Whiteboard",
    Touch.SMOOTH,
    material="enamel",
    scenario="table",
    session="2026-01-01",
)
SECONDS = 6.0


def plan(root: Path, takes: int = 2) -> SessionPlan:
    return SessionPlan(
        root,
        Reference(threshold_dbfs=-42.0),
        takes=TAKES[:takes],
        duration=SECONDS,
        countdown=0.5,
    )


def session(
    root: Path, takes: int = 2, *, known: Dataset | None = None, fault: str = ""
) -> Recorder:
    """A whole session with a simulated person, in virtual time."""
    participant = SimulatedParticipant(find("whiteboard"), gain_db=-12)
    source = FaultySource(participant, [FaultSpan(fault)] if fault else [])
    recorder = Recorder(
        TARGET, plan(root, takes), known, sample_rate=48_000, channels=2
    )
    blocks = iter(source)
    while recorder.protocol.stage is not Stage.DONE:
        if recorder.protocol.stage is Stage.READY:
            participant.take(TAKES[TAKES.index(recorder.protocol.take)], SECONDS + 0.5)
        if recorder.protocol.stage in (Stage.READY, Stage.REVIEW):
            recorder.press(Key.GO)
        recorder.push(next(blocks))
    return recorder


@pytest.mark.slow
def test_a_session_makes_a_data_set_that_has_nothing_wrong(tmp_path: Path) -> None:
    recorder = session(tmp_path, takes=3)
    dataset = open_dataset(tmp_path)
    assert check(dataset) == ()
    assert [recording.take for recording in dataset.recordings] == [
        "long_light",
        "long_medium",
        "long_loud",
    ]
    assert [recording.known("quality") for recording in recorder.recordings] == [
        "good"
    ] * 3
    assert {
        soundfile.info(recording.path).duration for recording in dataset.recordings
    } == {SECONDS}
    first = dataset.recordings[0]
    assert first.path == tmp_path / "whiteboard" / "table" / "long_light.flac"
    assert (first.surface, first.label, first.scenario) == (
        "Whiteboard",
        Touch.SMOOTH,
        "table",
    )
    assert (
        first.known("material"),
        first.known("pressure"),
        first.known("stroke"),
    ) == ("enamel", "light", "long")


def test_an_object_is_known_again_by_a_name_that_ends_in_a_line_end() -> None:
    padded = replace(TARGET, name=f"{TARGET.name}\r", session=f" {TARGET.session}\r\n")
    assert padded == TARGET


@pytest.mark.slow
def test_a_second_session_makes_what_is_missing_only(tmp_path: Path) -> None:
    session(tmp_path, takes=1)
    again = session(tmp_path, takes=2, known=open_dataset(tmp_path))
    assert [recording.take for recording in again.recordings] == ["long_medium"]
    assert len(open_dataset(tmp_path).recordings) == 2


@pytest.mark.slow
def test_a_fault_in_a_take_is_in_its_quality(tmp_path: Path) -> None:
    recorder = session(tmp_path, takes=1, fault="air-dead")
    assert "air microphone dead" in recorder.quality
    assert "air microphone dead" in open_dataset(tmp_path).recordings[0].known(
        "quality"
    )


def begun(root: Path) -> tuple[Recorder, "object"]:
    recorder = Recorder(TARGET, plan(root), None, sample_rate=48_000, channels=2)
    blocks = iter(SimulatedParticipant(find("lava stone")))
    recorder.press(Key.GO)
    for _ in range(150):
        recorder.push(next(blocks))
    return recorder, blocks


def test_quitting_keeps_what_was_recorded(tmp_path: Path) -> None:
    recorder, _ = begun(tmp_path)
    recorder.close()
    (kept,) = open_dataset(tmp_path).recordings
    assert soundfile.info(kept.path).duration == 1.0
    assert "ends after 1.0 of 6 s" in kept.known("quality")


def test_retaking_before_the_end_keeps_nothing(tmp_path: Path) -> None:
    recorder, _ = begun(tmp_path)
    recorder.press(Key.RETAKE)
    assert recorder.protocol.stage is Stage.READY
    assert not list(tmp_path.rglob("*.*"))


def test_a_pause_is_noted(tmp_path: Path) -> None:
    recorder, blocks = begun(tmp_path)
    recorder.press(Key.GO)
    for _ in range(50):
        recorder.push(next(blocks))
    recorder.press(Key.GO)
    while recorder.protocol.stage is Stage.RECORDING:
        recorder.push(next(blocks))
    assert open_dataset(tmp_path).recordings[0].known("pauses") == "1"


@pytest.mark.parametrize(
    ("name", "scenario"),
    [("Whiteboard!", "table"), ("whiteboard", "table"), ("Whiteboard", "Table")],
)
def test_no_take_replaces_that_of_another_object_of_the_same_file_name(
    name: str, scenario: str, tmp_path: Path
) -> None:
    """The first object's sound and its line were gone without a word."""
    first = TARGET.recording(tmp_path, TAKES[0], 2)
    other = RecordedObject(name, Touch.ROUGH, scenario=scenario)
    again = replace(TARGET, session="another day")
    known = Dataset("test", tmp_path, (first,))
    options = {"sample_rate": 48_000, "channels": 2}
    Recorder(again, plan(tmp_path), known, **options)
    with pytest.raises(DatasetError, match="more than signs, spaces and case"):
        Recorder(other, plan(tmp_path), known, **options)
    first.path.parent.mkdir(parents=True)
    first.path.touch()
    with pytest.raises(DatasetError, match=r"no metadata\.csv says what"):
        Recorder(TARGET, plan(tmp_path), None, **options)


def test_no_take_begins_over_sound_that_nothing_describes(tmp_path: Path) -> None:
    part = TARGET.recording(tmp_path, TAKES[1], 2).path.with_suffix(PART)
    part.parent.mkdir(parents=True)
    soundfile.write(part, np.zeros((48_000, 2)), 48_000)
    with pytest.raises(DatasetError, match=r"1\.0 s of a take that was cut off"):
        Recorder(TARGET, plan(tmp_path), None, sample_rate=48_000, channels=2)


def test_sound_that_was_lost_is_named_and_its_places_are_noted(tmp_path: Path) -> None:
    """The halves were joined without a word."""
    losses = 0
    recorder = Recorder(
        TARGET,
        plan(tmp_path),
        None,
        sample_rate=48_000,
        channels=2,
        device_losses=lambda: losses,
    )
    blocks = iter(SimulatedParticipant(find("lava stone")))
    recorder.press(Key.GO)
    while recorder.protocol.stage is not Stage.REVIEW:
        block = next(blocks)
        if 2.0 <= block.time < 2.1 or 3.0 <= block.time < 3.05:
            losses = 2
            continue
        recorder.push(block)
    (take,) = open_dataset(tmp_path).recordings
    assert take.known("gaps") == "1.500+0.100 2.400+0.050"
    for words in ("0.150 s of sound was lost (2 places)", "device lost sound 2 times"):
        assert words in take.known("quality")


def test_neither_a_pause_nor_what_was_lost_before_the_take_is_missing_in_it(
    tmp_path: Path,
) -> None:
    recorder, blocks = begun(tmp_path)
    recorder.press(Key.GO)
    for _ in range(20):
        next(blocks)
    recorder.push(next(blocks))
    recorder.press(Key.GO)
    while recorder.protocol.stage is Stage.RECORDING:
        recorder.push(next(blocks))
    assert open_dataset(tmp_path).recordings[0].known("gaps") == ""


def test_a_level_that_is_no_number_is_named(tmp_path: Path) -> None:
    """A spreadsheet writes a comma in some countries."""
    properties = {"level_dbfs": "-33,7", "quality": "good"}
    take = TARGET.recording(tmp_path, TAKES[0], 2).with_properties(**properties)
    known = Dataset("test", tmp_path, (take,))
    with pytest.raises(DatasetError, match=r"'-33,7', not a number such as -33\.7"):
        Recorder(TARGET, plan(tmp_path), known, sample_rate=48_000, channels=2)
