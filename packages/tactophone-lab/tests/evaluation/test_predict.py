from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest
import soundfile

from tactophone import AudioBlock, DatasetError, Prediction, Touch
from tactophone.core.recordings.values import Recording, Segment
from tactophone_lab.datasets.open import open_dataset
from tactophone_lab.evaluation.predict import (
    TakePredictions,
    in_true_contact,
    scores_of,
    take_of,
)
from tests.folders import SAMPLE_RATE, audiofolder, write_sound


@dataclass
class LoudIsRough:
    """A small detector: an update each 100 samples, rough in proportion to its mean
    level, contact over 0.01."""

    name: str = "loud is rough"
    hop: float = 100 / SAMPLE_RATE
    latency: float = 0.0
    seen: int = 0
    rest: list[np.ndarray] = field(default_factory=list)

    def push(self, block: AudioBlock) -> list[Prediction]:
        assert block.start == self.seen
        self.seen += block.size
        whole = np.concatenate([*self.rest, block.samples[:, 0]])
        count = len(whole) // 100
        self.rest = [whole[100 * count :]]
        first = self.seen - len(whole)
        return [
            self._predict(whole[100 * n : 100 * n + 100], first + 100 * n)
            for n in range(count)
        ]

    def _predict(self, window: np.ndarray, start: int) -> Prediction:
        level = float(np.abs(window).mean())
        rough = min(level / 0.2, 1.0)
        touch = (
            Touch.NONE if level < 0.01 else Touch.ROUGH if rough > 0.5 else Touch.SMOOTH
        )
        bounds = start / SAMPLE_RATE, (start + 100) / SAMPLE_RATE
        return Prediction(
            (0.0, 1 - rough, rough), touch, rough, 20 * np.log10(level + 1e-9), *bounds
        )

    def flush(self) -> list[Prediction]:
        return []

    def reset(self) -> None:
        self.seen, self.rest = 0, []


def predict(recording: Recording) -> TakePredictions:
    detector = LoudIsRough()
    return take_of(
        recording,
        [
            each
            for block in recording.blocks(channels=2)
            for each in detector.push(block)
        ],
    )


def test_each_recording_starts_with_a_fresh_detector(tmp_path: Path) -> None:
    recordings = open_dataset(audiofolder(tmp_path)).recordings
    first, again = predict(recordings[0]), predict(recordings[0])
    predict(recordings[1])
    assert np.array_equal(first.probabilities, again.probabilities)
    assert first.time[[0, -1]] == pytest.approx([0.025, 0.5])


def test_scores_take_only_updates_in_contact(tmp_path: Path) -> None:
    quiet = Recording(
        write_sound(tmp_path / "quiet.wav", level=0.005), "felt", Touch.SMOOTH
    )
    loud = Recording(
        write_sound(tmp_path / "loud.wav", level=0.5), "slate", Touch.ROUGH
    )
    unknown = Recording(loud.path, "other", None)
    scores = scores_of(map(predict, (quiet, loud, unknown)), "two-class")
    assert scores.names == ("slate",)
    assert scores.rough.all()
    assert len(scores.score) == 20


def test_nothing_in_contact_says_what_to_do(tmp_path: Path) -> None:
    quiet = Recording(
        write_sound(tmp_path / "quiet.wav", level=0.005), "felt", Touch.SMOOTH
    )
    with pytest.raises(DatasetError, match="the contact gate never opened"):
        scores_of([predict(quiet)], "authors")


def test_a_file_that_is_not_sound_is_named(tmp_path: Path) -> None:
    (tmp_path / "a.wav").write_text("words")
    with pytest.raises(DatasetError, match=r"a\.wav: cannot be read as sound"):
        predict(Recording(tmp_path / "a.wav", "slate"))


def test_a_file_with_too_few_channels_is_named(tmp_path: Path) -> None:
    mono = Recording(write_sound(tmp_path / "a.wav", channels=1), "slate", Touch.ROUGH)
    with pytest.raises(DatasetError, match="has 1 channel, but the model takes 2"):
        predict(mono)


RATE = 8000
TIME = 0.01 * np.arange(1, 401)
STROKES = ((0.5, 1.5), (2.5, 3.5))


def recorded(path: Path, *, rests: bool = True) -> Recording:
    rng = np.random.default_rng(0)
    level = np.full(4 * RATE, 1e-3)
    for start, end in STROKES if rests else ((0.0, 4.0),):
        level[round(start * RATE) : round(end * RATE)] = 0.1
    soundfile.write(
        path, rng.normal(0, 1, (4 * RATE, 1)) * level[:, None], RATE, subtype="FLOAT"
    )
    return Recording(path, "slate", Touch.ROUGH)


def contact(recording: Recording) -> np.ndarray:
    shape = len(TIME), 3
    take = TakePredictions(
        recording, TIME, np.full(shape, 1 / 3, np.float32), np.zeros(shape[0], bool)
    )
    return in_true_contact(take).contact


def test_rests_without_segments_are_no_contact(tmp_path: Path) -> None:
    found = contact(recorded(tmp_path / "a.wav"))
    expected = np.any(
        [(start < TIME) & (end >= TIME) for start, end in STROKES], axis=0
    )
    assert found[expected].mean() > 0.98
    # A touch lasts on over 0.1 s of silence, and noise is over its floor now and then.
    assert found[~expected].mean() < 0.35


@pytest.mark.parametrize("exists", [True, False])
def test_sound_without_a_rest_is_contact_throughout(
    tmp_path: Path, exists: bool
) -> None:
    recording = (
        recorded(tmp_path / "a.wav", rests=False)
        if exists
        else Recording(tmp_path / "b.wav", "slate")
    )
    assert contact(recording).all()


def test_segments_come_before_the_sound(tmp_path: Path) -> None:
    recording = recorded(tmp_path / "a.wav")
    labelled = Recording(
        recording.path, "slate", Touch.ROUGH, segments=(Segment(0.0, 1.0, "rough"),)
    )
    assert contact(labelled).tolist() == (TIME <= 1.0).tolist()
