from pathlib import Path

import pytest

from tactophone.evaluation.judging import scores_of
from tactophone.evaluation.metrics import measure
from tactophone.evaluation.vibration import VibrationMethod
from tactophone.haptics import SOUNDING
from tests.surfaces import surfaces


@pytest.mark.parametrize("name", SOUNDING)
def test_a_finger_could_tell_scrapes_by_the_sound_alone(name: str, tmp_path: Path) -> None:
    recordings = surfaces(tmp_path).recordings
    judge = VibrationMethod(name).fit(recordings[:4])
    assert measure(scores_of(map(judge, recordings[4:]), "two-class"))["balanced_accuracy"] > 0.6
