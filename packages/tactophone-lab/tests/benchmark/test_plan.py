import math
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import soundfile

from tactophone.core.errors import ConfigError
from tactophone.core.microphones import AIR
from tactophone.core.recordings.values import Dataset
from tactophone_lab.benchmark.folds import Cache
from tactophone_lab.benchmark.markdown_report import (
    REPORT_COLUMNS,
    row_of,
    write_report,
)
from tactophone_lab.benchmark.methods import (
    FAST_STEPS,
    NO_AIR,
    method_names,
    methods_for,
)
from tactophone_lab.benchmark.plan import (
    folds_with_edges,
    origin_of,
    run_benchmark,
    splits_of,
)
from tactophone_lab.benchmark.results import DatasetResults, MethodResult
from tests.surfaces import surfaces

METHODS = ("level", "rules", "direct", NO_AIR, "texture")


pytestmark = pytest.mark.long


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    """Surfaces whose air microphone has noise of its own: two that hear the same sound
    are a fault, and nothing is felt of it."""
    made = surfaces(tmp_path_factory.mktemp("scrapes"), each=6)
    rng = np.random.default_rng(0)
    for take in made.recordings:
        sound, rate = soundfile.read(take.path)
        sound[:, AIR] += 1e-2 * rng.standard_normal(len(sound))
        soundfile.write(take.path, sound, rate, subtype="FLOAT")
    return made


@pytest.fixture(scope="module")
def outcome(dataset: Dataset) -> DatasetResults:
    return run_benchmark(dataset, METHODS, ["3-fold"], Cache(dataset.root / "cache"))


@pytest.fixture(scope="module")
def results(outcome: DatasetResults) -> tuple[MethodResult, ...]:
    return outcome.results


def test_texture_separates_scrapes_and_level_does_not(
    results: tuple[MethodResult, ...],
) -> None:
    by_name = {result.method: result for result in results}
    assert list(by_name) == list(METHODS)
    assert by_name["texture"].scores["two-class"]["balanced_accuracy"].value > 0.9
    assert by_name["level"].scores["two-class"]["balanced_accuracy"].value < 0.9
    assert by_name["texture"].calibration_error < 0.2


def test_delays_are_measured_after_contact_and_after_edges(
    results: tuple[MethodResult, ...],
) -> None:
    texture = results[-1]
    assert 0 < texture.contact_ms[0] < 150
    assert 0 < texture.edge_ms[0] < 600


def test_all_but_the_reference_are_compared_with_it(
    results: tuple[MethodResult, ...],
) -> None:
    assert not results[0].differences
    assert results[-1].differences["balanced_accuracy"].estimate.value > 0
    assert results[-1].differences["balanced_accuracy"].p < 0.1


def test_the_same_model_works_when_the_air_microphone_is_silent(
    results: tuple[MethodResult, ...],
) -> None:
    both, contact_alone = (
        result.scores["two-class"]["auc"].value for result in (results[-1], results[-2])
    )
    assert contact_alone > 0.9
    assert contact_alone != both


def test_permuted_labels_score_about_chance(outcome: DatasetResults) -> None:
    (permuted,) = outcome.permuted.values()
    assert len(permuted) == 3
    assert sum(permuted) / 3 < 0.7


def test_edges_join_held_out_surfaces_only(dataset: Dataset, tmp_path: Path) -> None:
    for fold in folds_with_edges(dataset, "3-fold", tmp_path):
        own = {take.surface for take in fold.test if take.label is not None}
        for edge in (take for take in fold.test if take.label is None):
            assert set(edge.surface.split(" to ")) <= own
            assert not set(edge.surface.split(" to ")) & {
                take.surface for take in fold.train
            }


def test_splits_follow_the_keys_that_the_data_has(dataset: Dataset) -> None:
    assert splits_of(dataset) == ("leave-one-kin-out", "5-fold")
    assert splits_of(dataset, fast=True) == ("3-fold",)
    takes = [
        replace(take, session=f"{k}", scenario="ab"[k % 2])
        for k, take in enumerate(dataset.recordings)
    ]
    with_sessions = replace(dataset, recordings=tuple(takes))
    assert splits_of(with_sessions)[2:] == (
        "leave-one-scenario-out",
        "5-fold-by-session",
    )


def test_simulated_sound_is_named(dataset: Dataset) -> None:
    assert origin_of(dataset) == "as recorded"
    simulated = replace(dataset.recordings[0], properties={"source": "simulated"})
    assert origin_of(replace(dataset, recordings=(simulated,))) == "SIMULATED sound"


def test_methods(dataset: Dataset) -> None:
    names = [method.name for method in methods_for(dataset)]
    assert names[0] == "paper/general"
    assert names[-1] == "texture"
    assert set(names) == set(method_names(2))
    with pytest.raises(ConfigError, match="no method guesswork"):
        methods_for(dataset, ["guesswork"])


def test_a_fast_benchmark_trains_the_network_for_fewer_steps(dataset: Dataset) -> None:
    full, fast = (
        methods_for(dataset, ["paper/general", "texture"], fast=fast)
        for fast in (False, True)
    )
    networks = [methods[0].identity for methods in (full, fast)]
    assert (
        networks[0]
        == networks[1].replace(f"least_steps={FAST_STEPS}", "least_steps=600")
        != networks[1]
    )
    assert full[1] == fast[1]


def test_the_report_has_every_result_and_its_figures_beside_it(
    outcome: DatasetResults, tmp_path: Path, dataset: Dataset
) -> None:
    results = outcome.results
    page = write_report(tmp_path, [outcome], notes=["a note"]).read_text()
    assert all(f"| {result.method} |" in page for result in results)
    figures = re.findall(r"!\[.*\]\(<(.*)>\)", page)
    assert len(figures) == 4
    assert all((tmp_path / name).read_text().count("<svg") == 1 for name in figures)
    assert "a note" in page
    assert "permuted labels" in page
    assert "perceptual" in page
    assert len(row_of(results[0])) == len(REPORT_COLUMNS)
    assert not math.isnan(results[0].bumps_per_minute)
