from pathlib import Path

import numpy as np
import pytest

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
    assert [path.name for path in paths] == ["day_1_smooth.wav", "day_1_rough.wav"]


def test_stones_are_three_smooth_and_two_rough() -> None:
    assert sorted(CompetitionRun(2, 3).order) == [Touch.SMOOTH] * 3 + [Touch.ROUGH] * 2


def test_the_hard_tasks_stones_are_painted_almost_smooth_and_touched_lightly() -> None:
    easy, hard = (CompetitionRun(1, 1, task=TASKS[name]) for name in ("box", "hard"))
    rough = [
        next(obj for obj in run.scene.objects if obj.label is Touch.ROUGH).roughness.ra
        for run in (easy, hard)
    ]
    smooth = [
        next(obj for obj in run.scene.objects if obj.label is Touch.SMOOTH)
        for run in (easy, hard)
    ]
    assert smooth[0].surface == smooth[1].surface
    assert smooth[0].roughness.ra < rough[1] < 0.2 * rough[0]
    assert easy.fingerprint != hard.fingerprint
    (sound, truth), (quiet, touched) = map(render_run, (easy, hard))
    assert (
        touched.force[touched.touch == Touch.SMOOTH].mean()
        < truth.force[truth.touch == Touch.SMOOTH].mean() / 1.5
    )
    assert (
        np.std(quiet[touched.touch == Touch.ROUGH])
        < np.std(sound[truth.touch == Touch.ROUGH]) / 2
    )
