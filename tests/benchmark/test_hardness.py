from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from benchmarks.hardness import RULES, RuleMethod, measure_hardness

from tactophone.benchmark import cross_validate
from tactophone.dataset import Dataset, Recording, open_dataset, split
from tactophone.evaluation import false_positives_at_recall
from tactophone.evaluation.metrics import sort_scores
from tactophone.perception import CUES, cues
from tactophone.simulation import TAKES, RenderOptions, find, plan_dataset, render_dataset, write_manifest

TIME = np.arange(512) / 2000

pytestmark = pytest.mark.slow


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    folder = tmp_path_factory.mktemp("simulated")
    objects = [find(name) for name in ("0", "1", "3", "4")]
    jobs = plan_dataset(objects, RenderOptions(duration=3.0), takes=[TAKES[6]])
    for _ in render_dataset(folder, jobs):
        pass
    write_manifest(folder, jobs)
    return open_dataset(folder)


def test_cues_of_a_sine_at_the_networks_rate_have_the_textbook_values() -> None:
    contact = 0.1 * np.sin(2 * np.pi * 250 * TIME)
    values = dict(zip(CUES, cues(np.stack([contact, contact / 10], axis=1).astype(np.float32), 2000), strict=True))
    assert values["level_db"] == pytest.approx(-23.0, abs=0.1)
    assert 2 ** values["median_octaves"] == pytest.approx(250, abs=4)
    assert values["crest_db"] == pytest.approx(3.0, abs=0.1)
    assert values["air_to_contact_db"] == pytest.approx(-20.0, abs=0.1)


def test_false_positives_at_a_recall() -> None:
    score = np.arange(10) / 10
    rough = np.array([0, 0, 0, 0, 0, 1, 0, 1, 1, 1], bool)
    scores = sort_scores(score, rough=rough, surface=np.zeros(10, np.intp), names=("one",))
    assert false_positives_at_recall(scores, 0.75) == 0
    assert false_positives_at_recall(scores, 1.0) == pytest.approx(1 / 6)


@pytest.mark.parametrize("name", RULES)
def test_a_rule_predicts_windows_in_true_contact(dataset: Dataset, name: str) -> None:
    predictions = cross_validate(RuleMethod(name), split(dataset, "2-fold"))
    assert len(predictions) == 4
    assert all(take.contact.all() for take in predictions)
    assert sum(len(take.time) for take in predictions) > 100


@dataclass(frozen=True)
class Renamed:
    """A rule under another name, in the place of a trained method."""

    name: str
    rule: str

    @property
    def identity(self) -> str:
        return self.name

    def fit(self, recordings: list[Recording]) -> object:
        return RuleMethod(self.rule).fit(recordings)


def test_hardness_compares_in_pairs(dataset: Dataset, tmp_path: Path) -> None:
    methods = [Renamed("two", "air to contact"), Renamed("one", "air to contact")]
    hardness = measure_hardness(dataset, methods, by="2-fold")  # type: ignore[arg-type]
    assert hardness.difference.value == hardness.difference.low == hardness.difference.high == 0
    assert [row.name for row in hardness.rows[:2]] == ["two", "one"]
    assert set(hardness.air_over_contact_db) == {"smooth", "rough"}
