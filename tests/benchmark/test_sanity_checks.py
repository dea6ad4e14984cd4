from pathlib import Path

import numpy as np
import soundfile

from tactophone.benchmark.sanity_checks import HighBandControl
from tactophone.dataset import Recording
from tactophone.evaluation.metrics import measure
from tactophone.evaluation.predictions import scores_of
from tactophone.types import Touch

RATE = 44_100


def recordings(folder: Path, *, whistle: bool) -> list[Recording]:
    """Surfaces that sound alike, but for a faint whistle at 12 kHz on the days when rough ones were recorded."""
    made = []
    for number in range(8):
        rough = number % 2 == 1
        time = np.arange(RATE) / RATE
        sound = 0.05 * np.random.default_rng(number).standard_normal(RATE)
        sound += 0.01 * np.sin(2 * np.pi * 12_000 * time) * (whistle and rough)
        path = folder / f"{number}.wav"
        soundfile.write(path, sound, RATE)
        made.append(Recording(path, f"stone {number}", Touch.ROUGH if rough else Touch.SMOOTH))
    return made


def test_the_control_hears_a_days_noise_and_nothing_else(tmp_path: Path) -> None:
    for whistle, least, most in ((True, 0.95, 1.0), (False, 0.2, 0.8)):
        folder = tmp_path / str(whistle)
        folder.mkdir()
        made = recordings(folder, whistle=whistle)
        judge = HighBandControl().fit(made[:4])
        score = measure(scores_of(map(judge, made[4:]), "two-class"))["balanced_accuracy"]
        assert least <= score <= most
