from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import soundfile

from tactophone.evaluation.events import FADE, HALF, LEAD, SOURCES, join_edges
from tactophone.types import Touch
from tests.surfaces import RATE, surfaces


def test_edges_join_a_smooth_and_a_rough_touch_in_either_order(tmp_path: Path) -> None:
    edges = join_edges(surfaces(tmp_path).recordings, tmp_path / "edges")
    paths = {str(recording.path) for recording in surfaces(tmp_path).recordings}
    assert all(set(edge.properties[SOURCES].split("\n")) <= paths for edge in edges)
    orders = {tuple(segment.label for segment in edge.segments) for edge in edges}
    assert orders == {(Touch.NONE, Touch.SMOOTH, Touch.ROUGH), (Touch.NONE, Touch.ROUGH, Touch.SMOOTH)}
    sound, rate = soundfile.read(edges[0].path)
    assert (rate, sound.shape[1]) == (RATE, 2)
    assert len(sound) / rate == pytest.approx(LEAD + 2 * HALF - FADE, abs=1e-3)
    assert edges[0].segments[-1].end == pytest.approx(len(sound) / rate, abs=1e-3)


def test_there_is_no_silence_at_an_edge(tmp_path: Path) -> None:
    for edge in join_edges(surfaces(tmp_path).recordings, tmp_path / "edges"):
        sound, rate = soundfile.read(edge.path)
        middle = round(edge.segments[1].end * rate)
        near = sound[middle - rate // 50 : middle + rate // 50, 0]
        assert np.square(near).mean() > 0.1 * np.square(sound[rate // 4 :, 0]).mean() / 10


def test_one_kind_has_no_edges_and_the_same_seed_has_the_same(tmp_path: Path) -> None:
    recordings = surfaces(tmp_path).recordings
    assert join_edges(recordings[::2], tmp_path / "edges") == []
    again = [join_edges(recordings, tmp_path / "edges") for _ in range(2)]
    assert [edge.path for edge in again[0]] == [edge.path for edge in again[1]]


def test_without_segments_the_middle_of_a_touch_is_found_by_the_noise_floor(tmp_path: Path) -> None:
    labelled = surfaces(tmp_path).recordings
    for take in labelled:
        sound, rate = soundfile.read(take.path)
        rest = np.random.default_rng(0).normal(0, 1e-4, (3 * rate, sound.shape[1]))
        soundfile.write(take.path, np.concatenate((sound, rest)), rate)
    edges = join_edges([replace(take, segments=()) for take in labelled], tmp_path / "edges")
    assert edges
    for edge in edges:
        sound, rate = soundfile.read(edge.path)
        # In the middle of either half, well over the noise.
        for middle in (LEAD + HALF / 2, LEAD + 1.5 * HALF):
            place = round(middle * rate)
            assert np.square(sound[place : place + rate // 10, 0]).mean() > 1e-6
