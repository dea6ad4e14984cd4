from pathlib import Path

import numpy as np
import pytest

from tactophone.core.recordings.layouts import read_authors
from tactophone.core.types import Touch
from tactophone_lab.simulation.competition import (
    TASKS,
    CompetitionRun,
    render_run,
    run_recording,
    write_finals,
    write_run,
)

pytestmark = pytest.mark.slow


def test_a_run_visits_all_stones_and_has_its_truth(tmp_path: Path) -> None:
    run = CompetitionRun(day=1, number=1)
    write_run(tmp_path, run)
    recording = run_recording(tmp_path, run)
    labels = [segment.label_name for segment in recording.segments]
    assert labels.count("rough") >= 2
    assert labels.count("smooth") >= 3
    assert sorted(recording.known("stones").split()) == ["rough"] * 2 + ["smooth"] * 3


def test_days_and_runs_differ() -> None:
    first, second = render_run(CompetitionRun(1, 1)), render_run(CompetitionRun(2, 1))
    assert first[0].shape != second[0].shape or not np.array_equal(first[0], second[0])
    assert {CompetitionRun(1, number).order for number in range(10)} != {
        CompetitionRun(1, 1).order
    }


def test_finals_hold_one_label_each(tmp_path: Path) -> None:
    paths = write_finals(tmp_path, [CompetitionRun(1, 1)])
    assert [path.name for path in paths] == [
        "sample_smooth.wav",
        "sample_rough.wav",
        "day_1_smooth.wav",
        "day_1_rough.wav",
    ]
    dataset = read_authors(tmp_path)
    assert not dataset.problems
    samples = [take for take in dataset.recordings if take.session == "sample"]
    assert {take.label for take in samples} == {Touch.SMOOTH, Touch.ROUGH}
    assert {take.known("split") for take in samples} == {""}


def test_stones_are_three_smooth_and_two_rough() -> None:
    assert sorted(CompetitionRun(2, 3).order) == [Touch.SMOOTH] * 3 + [Touch.ROUGH] * 2


def test_the_finals_have_the_stones_of_the_box_touched_lightly_and_slowly() -> None:
    box, finals = (CompetitionRun(1, 1, task=TASKS[name]) for name in ("box", "finals"))
    assert box.scene == finals.scene
    assert box.fingerprint != finals.fingerprint
    (_, pressed), (_, touched) = map(render_run, (box, finals))
    assert (
        touched.force[touched.touch == Touch.SMOOTH].mean()
        < pressed.force[pressed.touch == Touch.SMOOTH].mean() / 1.5
    )
    assert len(touched.touch) < len(pressed.touch)


def test_a_rough_stone_is_rougher_than_every_smooth_one() -> None:
    for name, task in TASKS.items():
        placed = CompetitionRun(1, 1, task=task).scene.placed
        ra = {
            label: [
                each.object.roughness.ra
                for each in placed
                if each.object.label is label
            ]
            for label in (Touch.SMOOTH, Touch.ROUGH)
        }
        assert min(ra[Touch.ROUGH]) > 3 * max(ra[Touch.SMOOTH]), name


def test_the_manifest_states_ra_of_each_stone(tmp_path: Path) -> None:
    run = CompetitionRun(day=1, number=1)
    stated = run_recording(tmp_path, run).known("ra_um").split()
    smooth = [
        float(ra)
        for ra, word in zip(stated, run.order, strict=True)
        if word is Touch.SMOOTH
    ]
    assert len(stated) == 5
    assert max(smooth) < 10


def test_opus_changes_the_sound_and_nothing_else() -> None:
    plain, coded = (CompetitionRun(1, 1, opus=opus) for opus in (False, True))
    (sound, truth), (passed, same) = map(render_run, (plain, coded))
    assert sound.shape == passed.shape
    assert np.array_equal(truth.touch, same.touch)
    assert not np.array_equal(sound, passed)
    assert plain.fingerprint != coded.fingerprint
