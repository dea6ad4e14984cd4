from pathlib import Path

import numpy as np
import pytest
import soundfile

from tactophone.core.errors import DatasetError
from tactophone.core.types import Touch
from tactophone.signal.perception.health import FAULT_CLIPPED_SHARE, clipped_samples
from tactophone_lab.datasets.open import open_dataset
from tactophone_lab.simulation.catalogue import find
from tactophone_lab.simulation.modes import Mounting
from tactophone_lab.simulation.render import (
    RenderOptions,
    plan_dataset,
    render,
    render_dataset,
    write_manifest,
)
from tactophone_lab.simulation.takes import TAKES

BRIEF = RenderOptions(duration=1.0)


def test_a_set_is_rendered_once_with_its_manifest(tmp_path: Path) -> None:
    jobs = plan_dataset([find("lava stone")], BRIEF, takes=TAKES[:2])
    assert list(render_dataset(tmp_path, jobs)) == list(jobs)
    assert write_manifest(tmp_path, jobs) == 2
    before = (tmp_path / jobs[0].name).stat().st_mtime_ns
    list(render_dataset(tmp_path, jobs))
    assert (tmp_path / jobs[0].name).stat().st_mtime_ns == before
    recording = open_dataset(tmp_path).recordings[0]
    assert (recording.surface, recording.label, recording.take) == (
        "lava",
        Touch.ROUGH,
        "long_light",
    )
    assert recording.segments[-1].end == pytest.approx(1.0)
    assert float(recording.known("ra_um")) > 10


def test_lines_of_other_recordings_stay_and_no_recording_is_replaced(
    tmp_path: Path,
) -> None:
    """A manifest listed nothing but what had just been rendered."""
    manifest = tmp_path / "metadata.csv"
    manifest.write_text("file_name,surface,label\nslate/a.flac,slate,rough\n")
    for name in ("3", "lava stone"):
        jobs = plan_dataset([find(name)], BRIEF, takes=TAKES[:1])
        list(render_dataset(tmp_path, jobs))
        write_manifest(tmp_path, jobs)
    first, *rendered = open_dataset(tmp_path).recordings
    assert (first.surface, first.label, len(rendered)) == ("slate", Touch.ROUGH, 2)
    recorded = tmp_path / jobs[0].name
    soundfile.write(recorded, np.zeros((480, 2)), 48_000, format="FLAC")
    sound = recorded.read_bytes()
    with pytest.raises(DatasetError, match="was not rendered"):
        list(render_dataset(tmp_path, jobs))
    assert recorded.read_bytes() == sound
    manifest.write_text("file_name,surface,label\nslate/a.flac,slate,raugh\n")
    with pytest.raises(DatasetError, match="'raugh' is not a label"):
        next(render_dataset(tmp_path, jobs))


def test_slides_begin_after_the_finger_has_landed(tmp_path: Path) -> None:
    jobs = plan_dataset(
        [find("lava stone")], RenderOptions(duration=2.0), takes=TAKES[4:5]
    )
    list(render_dataset(tmp_path, jobs))
    write_manifest(tmp_path, jobs)
    (recording,) = open_dataset(tmp_path).recordings
    first, *_ = (
        tuple(map(float, entry.split("-")))
        for entry in recording.known("slides").split()
    )
    touch = next(segment for segment in recording.segments if segment.contact)
    assert touch.start + 0.05 < first[0] < first[1] <= touch.end + 0.05


def test_a_file_of_other_options_is_rendered_again(tmp_path: Path) -> None:
    (job,) = plan_dataset([find("3")], BRIEF, takes=TAKES[:1])
    list(render_dataset(tmp_path, [job]))
    (other,) = plan_dataset(
        [find("3")], RenderOptions(duration=1.0, seed=1), takes=TAKES[:1]
    )
    assert write_manifest(tmp_path, [other]) == 0
    list(render_dataset(tmp_path, [other]))
    assert write_manifest(tmp_path, [other]) == 1


def test_movable_objects_are_rendered_in_three_scenarios() -> None:
    jobs = plan_dataset(
        [find("lava stone"), find("whiteboard")], BRIEF, scenarios=True, takes=TAKES[:1]
    )
    assert [job.mounting for job in jobs] == [
        Mounting.HELD,
        Mounting.TABLE,
        Mounting.BOX,
        Mounting.FIXED,
    ]


def test_the_authors_layout_reads_as_the_authors_layout(tmp_path: Path) -> None:
    jobs = plan_dataset(
        [find("lava stone")],
        RenderOptions(duration=0.5, authors_layout=True),
        takes=TAKES[:1],
    )
    list(render_dataset(tmp_path, jobs))
    write_manifest(tmp_path, jobs)
    assert [path.name for path in tmp_path.rglob("*.*")] == ["00_long_light.wav"]
    assert open_dataset(tmp_path).recordings[0].label == Touch.ROUGH


def test_opus_changes_the_sound_but_not_its_place() -> None:
    (plain,) = plan_dataset(
        [find("lava stone")], RenderOptions(duration=1.0), takes=TAKES[1:2]
    )
    (coded,) = plan_dataset(
        [find("lava stone")], RenderOptions(duration=1.0, opus=True), takes=TAKES[1:2]
    )
    before, after = render(plain)[0][:, 0], render(coded)[0][:, 0]
    assert before.shape == after.shape
    assert not np.array_equal(before, after)
    assert np.corrcoef(before[4800:], after[4800:])[0, 1] > 0.95


def test_sound_is_complete_and_stereo(tmp_path: Path) -> None:
    (job,) = plan_dataset(
        [find("4")], RenderOptions(duration=0.5, bits=24), takes=TAKES[:1]
    )
    list(render_dataset(tmp_path, [job]))
    info = soundfile.info(tmp_path / job.name)
    assert (info.samplerate, info.channels, info.frames, info.subtype) == (
        48_000,
        2,
        24_000,
        "PCM_24",
    )
    assert not list(tmp_path.rglob(".*.flac"))


def test_a_lower_gain_clips_less() -> None:
    clipped = []
    for gain_db in (0.0, -12.0):
        options = RenderOptions(duration=2.0, gain_db=gain_db)
        (job,) = plan_dataset([find("17")], options, takes=TAKES[2:3])
        clipped.append(clipped_samples(render(job)[0].T).mean(axis=1)[0])
    assert clipped[1] < FAULT_CLIPPED_SHARE < clipped[0]
