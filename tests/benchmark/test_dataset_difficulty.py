from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest

from tactophone.benchmark.crossvalidation import cross_validate
from tactophone.benchmark.dataset_difficulty import (
    RULES,
    RuleMethod,
    air_to_contact,
    false_positives,
    level,
    measure_hardness,
    median_frequency,
    transients,
)
from tactophone.dataset import Dataset, Recording, open_dataset, split
from tactophone.evaluation.metrics import collect
from tactophone.simulation import TAKES, find
from tactophone.simulation.content.generate import Style, finish, make, plan

TIME = np.arange(512) / 2000


def window(contact: np.ndarray, air: np.ndarray | None = None) -> np.ndarray:
    channels = [contact, contact / 10 if air is None else air]
    return np.stack(channels, axis=-1)[None].astype(np.float32)


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    folder = tmp_path_factory.mktemp("simulated")
    things = [find(name) for name in ("0", "1", "3", "4")]
    jobs = plan(things, Style(duration=3.0), takes=[TAKES[6]])
    for _ in make(folder, jobs):
        pass
    finish(folder, jobs)
    return open_dataset(folder)


def test_cues_of_a_sine_are_the_textbooks() -> None:
    tone = window(0.1 * np.sin(2 * np.pi * 250 * TIME))
    assert level(tone)[0, 0] == pytest.approx(-23.0, abs=0.1)
    assert median_frequency(tone)[0, 0] == pytest.approx(250, abs=4)
    assert transients(tone)[0, 1] == pytest.approx(3.0, abs=0.1)
    assert np.exp(transients(tone)[0, 2]) == pytest.approx(1.5, abs=0.02)
    assert air_to_contact(tone)[0, 0] == pytest.approx(-20.0, abs=0.1)


def test_false_positives_at_a_recall() -> None:
    score = np.arange(10) / 10
    rough = np.array([0, 0, 0, 0, 0, 1, 0, 1, 1, 1], bool)
    scores = collect(score, rough=rough, surface=np.zeros(10, np.intp), names=("one",))
    assert false_positives(scores, np.ones(10), recall=0.75) == 0
    assert false_positives(scores, np.ones(10), recall=1.0) == pytest.approx(1 / 6)


@pytest.mark.parametrize("name", RULES)
def test_a_rule_judges_what_truly_touches(dataset: Dataset, name: str) -> None:
    judged = cross_validate(RuleMethod(name), split(dataset, "2-fold"))
    assert len(judged) == 4
    assert all(one.contact.all() for one in judged)
    assert sum(map(len, (one.time for one in judged))) > 100


@dataclass(frozen=True)
class Renamed:
    """The level's rule under a name of its own, in the place of a learnt method."""

    name: str
    rule: str

    @property
    def identity(self) -> str:
        return self.name

    def fit(self, recordings: list[Recording]) -> object:
        return RuleMethod(self.rule).fit(recordings)


def test_hardness_compares_in_pairs(dataset: Dataset, tmp_path: Path) -> None:
    methods = [Renamed("two", "air to contact"), Renamed("one", "air to contact")]
    found = measure_hardness(dataset, methods, by="2-fold")  # type: ignore[arg-type]
    assert found.difference.value == found.difference.low == found.difference.high == 0
    assert [row.name for row in found.rows[:2]] == ["two", "one"]
    assert set(found.air_over_contact_db) == {"smooth", "rough"}
