from pathlib import Path

import pytest

from tactophone.benchmark.vibration_method import VibrationMethod
from tactophone.evaluation.metrics import measure
from tactophone.evaluation.predictions import scores_of
from tactophone.haptics import PASSTHROUGH
from tests.surfaces import surfaces


@pytest.mark.parametrize("name", PASSTHROUGH)
def test_a_finger_could_tell_scrapes_by_the_sound_alone(name: str, tmp_path: Path) -> None:
    recordings = surfaces(tmp_path).recordings
    judge = VibrationMethod(name).fit(recordings[:4])
    assert measure(scores_of(map(judge, recordings[4:]), "two-class"))["balanced_accuracy"] > 0.6
