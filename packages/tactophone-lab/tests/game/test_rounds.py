"""Rules of the stone box."""

from pathlib import Path

import numpy as np
import pytest

from tactophone.core.types import Touch
from tactophone_lab.game.stone_box import (
    LIFTED_PRESSURE,
    PITCH,
    WIDTH,
    Point,
    Round,
    RoundResult,
    read_results,
    within_reach,
)

SMOOTH, ROUGH = Touch.SMOOTH, Touch.ROUGH
ORDER = (SMOOTH, ROUGH, SMOOTH, ROUGH, SMOOTH)


def stroke(game: Round, xs: np.ndarray, force: float = 1.5, y: float = 0.03) -> None:
    for k, x in enumerate(xs):
        game.touch(Point(0.01 * k, float(x), y, force))


def test_the_stones_are_where_the_simulation_places_them() -> None:
    from tactophone_lab.simulation.motion import DEPTH, five_stones

    for k, placed in enumerate(five_stones(ORDER).placed):
        assert (placed.left, placed.near, placed.width) == (
            pytest.approx(k * PITCH),
            0,
            WIDTH,
        )
        assert Point(0, *placed.centre, 1.0).stone == k
        assert Point(0, placed.centre[0], DEPTH + 0.001, 1.0).stone == -1
        assert placed.object.label is ORDER[k]


def test_back_and_forth_is_two_strokes_and_a_tap_is_none() -> None:
    game = Round(ORDER, seed=0)
    stroke(game, np.r_[np.linspace(0.02, 0.06, 20), np.linspace(0.06, 0.02, 20)])
    stroke(game, np.full(5, 0.25))
    assert game.strokes == [2, 0, 0, 0, 0]


def test_no_stroke_is_counted_in_the_air_or_across_a_gap() -> None:
    game = Round(ORDER, seed=0)
    stroke(game, np.linspace(0.02, 0.5, 100), force=LIFTED_PRESSURE)
    stroke(game, np.linspace(0.08, 0.113, 10))
    assert game.strokes == [0] * 5


def test_what_is_not_kept_counts_but_leaves_no_path() -> None:
    game = Round(ORDER, seed=7)
    for x in np.linspace(0.02, 0.06, 20):
        game.touch(last := Point(0.0, x, 0.03, 1.5), kept=False)
    assert game.strokes[0] == 1
    assert game.path == []
    assert game.here is last


@pytest.mark.parametrize(
    ("choices", "correct"), [([1, 3], 2), ([3, 1], 2), ([1, 0], 1), ([0, 4], 0)]
)
def test_a_choice_of_two_is_scored(choices: list[int], correct: int) -> None:
    game = Round(ORDER, seed=3)
    stroke(game, np.linspace(0.02, 0.06, 20))
    game.round_trips += [0.05, 0.07, 0.3]
    result = game.finish(choices, Point(12.5, 0, 0, LIFTED_PRESSURE), finished="now")
    assert (result.correct, result.duration, result.seed, result.round_trip) == (
        correct,
        12.5,
        3,
        0.07,
    )


@pytest.mark.parametrize("choices", [[], [1], [1, 1], [0, 1, 2], [1, 5], [-1, 2]])
def test_anything_but_two_stones_is_refused(choices: list[int]) -> None:
    with pytest.raises(ValueError, match="two of the stones"):
        Round(ORDER, seed=0).finish(
            choices, Point(1, 0, 0, LIFTED_PRESSURE), finished="now"
        )


@pytest.mark.parametrize("end", ["", "\n"])
def test_results_are_appended_and_read_back_and_a_broken_line_is_skipped(
    end: str, tmp_path: Path
) -> None:
    """A line without an end, as a full disk cuts it, took the next one with it."""
    path = tmp_path / "results.jsonl"
    assert read_results(path) == []
    result = RoundResult("now", 1, ("rough", "smooth"), (0, 1), 1, 2.0, (3, 4))
    result.append(path)
    with path.open("a") as file:
        file.write('{"finished": "half a li' + end)
    result.append(path)
    assert [entry.seed for entry in read_results(path)] == [1, 1]


@pytest.mark.parametrize("force", [0.0, -3.0, float("nan")])
def test_no_pressure_lifts_the_finger(force: float) -> None:
    assert within_reach(0.1, 0.1, force, now=0).force == LIFTED_PRESSURE


def test_requests_are_clipped_to_the_box_and_to_a_hands_force() -> None:
    point = within_reach(9, -9, 1e9, now=0)
    assert (point.x, point.y, point.force) == (pytest.approx(0.54), -0.015, 5.0)


def test_the_track_has_the_truth_under_the_finger() -> None:
    game = Round(ORDER, seed=0)
    game.touch(Point(5.0, PITCH + 0.02, 0.03, 2.0))
    game.touch(Point(5.1, PITCH + 0.02, 0.03, LIFTED_PRESSURE))
    assert game.track(4.0).tolist() == [
        [1.0, PITCH + 0.02, 0.03, 2.0, ROUGH],
        [5.1 - 4, PITCH + 0.02, 0.03, LIFTED_PRESSURE, 0],
    ]


def test_lines_that_are_not_text_are_passed_over(tmp_path: Path) -> None:
    path = tmp_path / "results.jsonl"
    path.write_bytes(b"\xff\xfe\x00\n" + b"[" * 100_000 + b"\n{}\n")
    assert read_results(path) == []
