import math
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import soundfile
from scipy.ndimage import uniform_filter1d

from tactophone.core.recordings.values import Segment
from tactophone.core.types import Touch
from tactophone.signal.perception.decision import DecisionRule
from tactophone.signal.perception.evidence import TouchEvidence
from tactophone_lab.evaluation.bumps_and_delays import (
    EVENT_FADE,
    HALF,
    LEAD,
    SOURCES_KEY,
    calibration_error,
    contact_delays,
    decided_touches,
    dips_per_minute,
    edge_delays,
    false_bumps_per_minute,
    join_edges,
)
from tests.evaluation.takes import felt_rough, predicted
from tests.surfaces import RATE, surfaces

RULE = DecisionRule()


def test_without_what_was_felt_the_evidence_of_windows_in_contact_decides() -> None:
    contact = [True] * 30 + [False]
    take = predicted([0.2] * 10 + [0.95] * 21, label=Touch.ROUGH, contact=contact)
    touches = decided_touches(take, RULE)
    evidence = TouchEvidence(RULE)
    expected = []
    for now, row in zip(take.time, take.probabilities, strict=True):
        none, smooth, rough = row.astype(float).tolist()
        evidence.hear((none, smooth, rough), float(now))
        expected.append(Touch.ROUGH if evidence.is_rough(now) else Touch.SMOOTH)
    assert touches[:30].tolist() == expected[:30]
    assert Touch.ROUGH in expected
    assert touches[30] == Touch.NONE


def test_a_single_window_is_no_bump() -> None:
    share = np.zeros(600)
    share[[100, 300]] = 0.99
    take = predicted(share, label=Touch.SMOOTH)
    assert false_bumps_per_minute([take], RULE) == 0


def test_what_was_felt_is_what_is_scored() -> None:
    take = predicted([0.9] * 3, label=Touch.ROUGH)
    touch = np.array([Touch.NONE, Touch.SMOOTH, Touch.ROUGH], np.int8)
    assert decided_touches(replace(take, touch=touch), RULE) is touch


def test_bumps_closer_than_a_perceptible_gap_are_one() -> None:
    take = felt_rough(601, at=[100, 101, 103, 300], label=Touch.SMOOTH)
    assert false_bumps_per_minute([take], RULE) == pytest.approx(2 / 6 * 60)


def test_bumps_count_only_in_contact_with_a_smooth_surface() -> None:
    share = np.full(600, 0.9)
    half = predicted(
        share,
        label=Touch.SMOOTH,
        segments=[Segment(0, 3, "smooth"), Segment(3, 6, "none")],
    )
    assert false_bumps_per_minute([half], RULE) == pytest.approx(20, rel=0.01)
    assert math.isnan(
        false_bumps_per_minute([predicted(share, label=Touch.ROUGH)], RULE)
    )


def test_a_correct_decision_must_hold() -> None:
    segments = [Segment(0, 0.2, "none"), Segment(0.2, 1.0, "rough")]
    rough = felt_rough(
        100, at=[25, 26, *range(40, 100)], label=Touch.ROUGH, segments=segments
    )
    delays = contact_delays([rough], RULE, latency=0.003)
    assert delays.times.tolist() == pytest.approx([0.41 - 0.2 + 0.003])
    assert delays.missed == 0
    never = contact_delays(
        [felt_rough(100, at=[], label=Touch.ROUGH, segments=segments)],
        RULE,
        latency=0,
    )
    assert (never.missed, never.missed_share) == (1, 1.0)
    assert never.quantile_ms(0.5) == math.inf
    assert math.isnan(contact_delays([], RULE, latency=0).quantile_ms(0.5))


def test_delays_count_from_when_the_finger_slides() -> None:
    segments = [Segment(0, 0.2, "none"), Segment(0.2, 1.0, "rough")]
    late = range(55, 100)
    slides = felt_rough(
        100, at=late, label=Touch.ROUGH, segments=segments, slides="0.500-0.900"
    )
    assert contact_delays([slides], RULE, latency=0).times.tolist() == pytest.approx(
        [0.06]
    )
    mixed = felt_rough(100, at=late, label=None, segments=segments)
    assert contact_delays([slides, mixed], RULE, latency=0).missed == 0
    stands = felt_rough(
        100, at=late, label=Touch.ROUGH, segments=segments, slides="1.500-1.900"
    )
    assert len(contact_delays([stands], RULE, latency=0).times) == 0


def test_edges_are_changes_without_a_lift() -> None:
    segments = [
        Segment(0, 0.1, "none"),
        Segment(0.1, 0.6, "smooth"),
        Segment(0.6, 1.2, "rough"),
    ]
    edge = felt_rough(120, at=range(70, 120), label=None, segments=segments)
    delays = edge_delays([edge], RULE, latency=0)
    assert delays.times.tolist() == pytest.approx([0.11])


def test_calibration_error_is_the_gap_between_confidence_and_truth() -> None:
    right = [predicted([0.75] * 100, label=Touch.ROUGH)] * 3 + [
        predicted([0.75] * 100, label=Touch.SMOOTH)
    ]
    assert calibration_error(right) == pytest.approx(0, abs=1e-6)
    sure = [
        predicted([0.95] * 100, label=Touch.ROUGH),
        predicted([0.95] * 100, label=Touch.SMOOTH),
    ]
    assert calibration_error(sure) == pytest.approx(0.45, abs=1e-6)


def test_edges_join_a_smooth_and_a_rough_touch_in_either_order(tmp_path: Path) -> None:
    edges = join_edges(surfaces(tmp_path).recordings, tmp_path / "edges")
    paths = {str(recording.path) for recording in surfaces(tmp_path).recordings}
    assert all(set(edge.properties[SOURCES_KEY].split("\n")) <= paths for edge in edges)
    orders = {tuple(segment.label for segment in edge.segments) for edge in edges}
    assert orders == {
        (Touch.NONE, Touch.SMOOTH, Touch.ROUGH),
        (Touch.NONE, Touch.ROUGH, Touch.SMOOTH),
    }
    sound, rate = soundfile.read(edges[0].path)
    assert (rate, sound.shape[1]) == (RATE, 2)
    assert len(sound) / rate == pytest.approx(LEAD + 2 * HALF - EVENT_FADE, abs=1e-3)
    assert edges[0].segments[-1].end == pytest.approx(len(sound) / rate, abs=1e-3)


def test_there_is_no_silence_at_an_edge(tmp_path: Path) -> None:
    for edge in join_edges(surfaces(tmp_path).recordings, tmp_path / "edges"):
        sound, rate = soundfile.read(edge.path)
        middle = round(edge.segments[1].end * rate)
        near = sound[middle - rate // 50 : middle + rate // 50, 0]
        assert (
            np.square(near).mean() > 0.1 * np.square(sound[rate // 4 :, 0]).mean() / 10
        )


def test_one_kind_has_no_edges_and_the_same_seed_has_the_same(tmp_path: Path) -> None:
    recordings = surfaces(tmp_path).recordings
    assert join_edges(recordings[::2], tmp_path / "edges") == []
    again = [join_edges(recordings, tmp_path / "edges") for _ in range(2)]
    assert [edge.path for edge in again[0]] == [edge.path for edge in again[1]]


def test_without_segments_the_middle_of_a_touch_is_found_by_the_noise_floor(
    tmp_path: Path,
) -> None:
    labelled = surfaces(tmp_path).recordings
    for take in labelled:
        sound, rate = soundfile.read(take.path)
        # A room is duller than the hiss of a smooth surface: noise of one spectrum at
        # two levels would be noise under automatic gain.
        white = np.random.default_rng(0).normal(0, 3e-4, (3 * rate, sound.shape[1]))
        rest = uniform_filter1d(white, 16, axis=0)
        soundfile.write(take.path, np.concatenate((sound, rest)), rate)
    edges = join_edges(
        [replace(take, segments=()) for take in labelled], tmp_path / "edges"
    )
    assert edges
    for edge in edges:
        sound, rate = soundfile.read(edge.path)
        # In the middle of either half, well over the noise.
        for middle in (LEAD + HALF / 2, LEAD + 1.5 * HALF):
            place = round(middle * rate)
            assert np.square(sound[place : place + rate // 10, 0]).mean() > 1e-6


def test_dips_are_holes_of_rough_within_a_touch_of_a_rough_surface() -> None:
    rough = [*range(100), *range(110, 210)]
    take = felt_rough(220, at=rough, label=Touch.ROUGH)
    minutes = (take.time[-1] - take.time[0]) / 60
    assert dips_per_minute([take], RULE) == pytest.approx(1 / minutes)
    assert math.isnan(
        dips_per_minute([felt_rough(220, at=rough, label=Touch.SMOOTH)], RULE)
    )
