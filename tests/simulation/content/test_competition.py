import csv
from pathlib import Path

import numpy as np

from tactophone.simulation.content.competition import Run, make_finals, make_run, render_run, run_recording
from tactophone.types import Touch


def test_a_run_visits_all_stones_and_tells_the_truth(tmp_path: Path) -> None:
    run = make_run(tmp_path, Run(day=1, number=1))
    recording = run_recording(tmp_path, run)
    words = [one.word for one in recording.segments]
    assert words.count("rough") >= 2
    assert words.count("smooth") >= 3
    with (tmp_path / "day_1_run_1.csv").open() as file:
        stones = [row["stone"] for row in csv.DictReader(file) if row["touch"] in ("smooth", "rough")]
    assert sorted(set(stones)) == ["1", "2", "3", "4", "5"]


def test_days_and_runs_differ() -> None:
    first, second = render_run(Run(1, 1)), render_run(Run(2, 1))
    assert first[0].shape != second[0].shape or not np.array_equal(first[0], second[0])
    assert {Run(1, number).order for number in range(10)} != {Run(1, 1).order}


def test_finals_hold_one_label_each(tmp_path: Path) -> None:
    paths = make_finals(tmp_path, [Run(1, 1)])
    assert [path.name for path in paths] == ["day_1_smooth.wav", "day_1_rough.wav"]


def test_stones_are_three_smooth_and_two_rough() -> None:
    assert sorted(Run(2, 3).order) == [Touch.SMOOTH] * 3 + [Touch.ROUGH] * 2
