from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tactophone import Touch
from tactophone.benchmark.paper_methods import LevelMethod, PaperMethod
from tactophone.dataset import open_dataset
from tactophone.evaluation.predictions import TakePredictions
from tactophone.training.network.recipe import paper
from tactophone.training.network.training_job import OPEN_GATE, TrainingJob
from tests.dataset.folders import audiofolder

RECIPE = replace(paper("fine-tuned"), hop=32, batch_size=64, epochs=1, least_steps=80, learning_rate=3e-4)


def accuracy(judged: list[TakePredictions]) -> float:
    called = [np.mean(one.probabilities[:, 2] > one.probabilities[:, 1]) for one in judged]
    return float(
        np.mean(
            [(share > 0.5) == (one.recording.label is Touch.ROUGH) for share, one in zip(called, judged, strict=True)]
        )
    )


def test_level_alone_tells_loud_from_quiet_at_the_live_systems_times(tmp_path: Path) -> None:
    recordings = open_dataset(audiofolder(tmp_path)).recordings
    level, network = LevelMethod(2).fit(recordings), PaperMethod(TrainingJob(RECIPE, gate=OPEN_GATE)).fit(recordings)
    judged = [level(one) for one in recordings]
    assert accuracy(judged) == 1
    assert judged[0].time == pytest.approx(network(recordings[0]).time)


def test_the_papers_method_trains_and_judges_through_a_model_file(tmp_path: Path) -> None:
    recordings = open_dataset(audiofolder(tmp_path)).recordings
    method = PaperMethod(TrainingJob(RECIPE, gate=OPEN_GATE))
    judge = method.fit(recordings)
    judged = [judge(one) for one in recordings]
    assert all(one.contact.all() and len(one.time) for one in judged)
    assert accuracy(judged) > 0.7


def test_what_changes_the_answer_changes_the_identity() -> None:
    course = TrainingJob(RECIPE)
    others = [replace(course, seed=1), replace(course, recipe=paper("general")), replace(course, gate=OPEN_GATE)]
    assert len({PaperMethod(one).identity for one in (course, *others)}) == 4
