"""A notebook records an object as the verb does: by one function that returns its
takes."""

import itertools
import threading
import time
from pathlib import Path

import numpy as np
import pytest
import soundfile

from tactophone.core.errors import DatasetError
from tactophone.core.settings import Settings, change
from tactophone.core.types import Touch
from tactophone.live.audio.sources import LiveSource
from tactophone.signal.perception.health import Reference
from tactophone_lab.app.record import record_object
from tactophone_lab.recording.take_recorder import RecordedObject, SessionPlan
from tactophone_lab.simulation.takes import TAKES
from tests.folders import write_sound
from tests.live.audio.test_sources import HandDevice

FINGER = change(Settings(), ["capture.source=finger"])


@pytest.mark.slow
def test_a_simulated_finger_records_the_takes_that_the_folder_lacks(
    tmp_path: Path,
) -> None:
    target = RecordedObject("honed slate", Touch.ROUGH, session="monday")
    plan = SessionPlan(tmp_path, Reference(), tuple(TAKES)[:2], duration=1.0)
    said: list[str] = []
    stages = set()
    takes = record_object(
        FINGER,
        target,
        plan,
        follow=lambda recorder, _: stages.add(recorder.protocol.stage),
        report=said.append,
    )
    assert [take.take for take in takes] == [take.name for take in plan.takes]
    assert all(take.path.is_file() for take in takes)
    assert said == ["2 takes to record"]
    assert len(stages) > 2
    assert record_object(FINGER, target, plan, report=said.append) == []
    assert said[-1] == "all takes are recorded already"


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("a.wav,slate,raugh,", "'raugh' is not a label"),
        ("a.wav,slate,rough,0.0-0.4=sticky", "'sticky' is not a label"),
        ("a.wav,slate,rough,0.4", "not a segment"),
        ("../x/a.wav,slate,rough,", "names '../x/a.wav'"),
        ("a.wav,slate,rough,,doubtful", "'doubtful' stands in a column without a name"),
    ],
)
def test_nothing_is_recorded_while_the_manifest_holds_what_would_be_lost(
    line: str, words: str, tmp_path: Path
) -> None:
    """Labels, segments and lines that a person had written were gone."""
    manifest = tmp_path / "metadata.csv"
    manifest.write_text(f"file_name,surface,label,segments\n{line}\n")
    before = manifest.read_text()
    plan = SessionPlan(tmp_path, takes=TAKES[:1], duration=1.0)
    with pytest.raises(DatasetError, match=words):
        record_object(FINGER, RecordedObject("slate", Touch.ROUGH), plan)
    assert [path.name for path in tmp_path.iterdir()] == ["metadata.csv"]
    assert manifest.read_text() == before


@pytest.mark.parametrize("name", ["rough/stone.wav", "glass_smooth.wav"])
def test_nothing_is_recorded_where_a_manifest_would_hide_recordings(
    name: str, tmp_path: Path
) -> None:
    """All recordings of a folder that had no ``metadata.csv`` were out of sight."""
    write_sound(tmp_path / name)
    plan = SessionPlan(tmp_path, takes=TAKES[:1], duration=1.0)
    with pytest.raises(DatasetError, match=f"such as {name}, and a new metadata.csv"):
        record_object(FINGER, RecordedObject("slate", Touch.ROUGH), plan)
    assert not (tmp_path / "metadata.csv").exists()


def test_a_disk_that_is_slow_costs_a_take_no_sound(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What the microphones delivered while a disk was flushed was missing."""
    source = LiveSource(HandDevice, channels=2)
    monkeypatch.setattr("tactophone.app.sources.open_source", lambda _: source)
    patience = time.monotonic() + 20.0
    ended = threading.Event()
    numbers = itertools.count()
    delivered = 0

    def deliver() -> None:
        """Number each period; wait for the reader while there is patience, so that a
        busy machine loses nothing."""
        nonlocal delivered
        while not ended.is_set():
            source.device.deliver(next(numbers) / 2**15, 480)
            delivered += 1
            while source._taken < source._queued and time.monotonic() < patience:
                if ended.wait(0.0005):
                    return

    def flush_slowly(_: Path) -> None:
        """Take as long as 0.5 s of sound."""
        goal = delivered + 50
        while delivered < goal and time.monotonic() < patience + 1.0:
            time.sleep(0.0005)

    for module in ("core.processes", "_lab.recording.safe_writer"):
        name = f"tactophone.{module}.flush_to_disk".replace("._", "_")
        monkeypatch.setattr(name, flush_slowly)
    device = threading.Thread(target=deliver)
    plan = SessionPlan(tmp_path, takes=TAKES[:1], duration=2.0, countdown=0.1)
    target = RecordedObject("honed slate", Touch.ROUGH)
    try:
        device.start()
        (take,) = record_object(Settings(), target, plan)
    finally:
        ended.set()
        device.join()
    samples, _ = soundfile.read(take.path)
    assert set(np.diff(samples[::480, 0])) == {2**-15}
    assert "lost" not in take.known("quality")
