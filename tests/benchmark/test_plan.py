import math
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType

import pytest

from tactophone.benchmark.crossvalidation import Cache
from tactophone.benchmark.entries import AIR_DEAD, cost_of, entries_for, entry_names, measure_costs, plan_for
from tactophone.benchmark.page import COLUMNS, row_of, write_page
from tactophone.benchmark.plan import Findings, folds_with_edges, origin_of, run_plan, splits_of
from tactophone.benchmark.result import Result
from tactophone.dataset import Dataset
from tactophone.errors import ConfigError
from tactophone.perception import model_path
from tests.surfaces import surfaces

METHODS = ("level", "logistic", "direct", AIR_DEAD, "ours")


@pytest.fixture(scope="module")
def dataset(tmp_path_factory: pytest.TempPathFactory) -> Dataset:
    return surfaces(tmp_path_factory.mktemp("scrapes"), each=6)


@pytest.fixture(scope="module")
def findings(dataset: Dataset) -> Findings:
    return run_plan(plan_for(dataset, METHODS, ["3-fold"]), Cache(dataset.root / "cache"))


@pytest.fixture(scope="module")
def results(findings: Findings) -> tuple[Result, ...]:
    return findings.results


def test_ours_tells_scrapes_apart_and_level_does_not(results: tuple[Result, ...]) -> None:
    by_name = {one.method: one for one in results}
    assert list(by_name) == list(METHODS)
    assert by_name["ours"].scores["two-class"]["balanced_accuracy"].value > 0.9
    assert by_name["level"].scores["two-class"]["balanced_accuracy"].value < 0.9
    assert by_name["ours"].calibration_error < 0.2


def test_times_to_a_right_decision_are_told_after_contact_and_after_edges(results: tuple[Result, ...]) -> None:
    ours = results[-1]
    assert 0 < ours.contact_ms[0] < 150
    assert 0 < ours.edge_ms[0] < 300


def test_all_but_the_reference_are_compared_with_it(results: tuple[Result, ...]) -> None:
    assert not results[0].differences
    assert results[-1].differences["balanced_accuracy"].estimate.value > 0
    assert results[-1].differences["balanced_accuracy"].p < 0.1


def test_the_same_model_goes_on_when_the_air_microphone_dies(results: tuple[Result, ...]) -> None:
    ours, deafened = (one.scores["two-class"]["auc"].value for one in (results[-1], results[-2]))
    assert deafened > 0.9
    assert deafened != ours


def test_labels_dealt_anew_are_no_better_than_chance(findings: Findings) -> None:
    (dealt,) = findings.dealt.values()
    assert len(dealt) == 3
    assert sum(dealt) / 3 < 0.7


def test_edges_are_made_of_held_out_surfaces_alone(dataset: Dataset, tmp_path: Path) -> None:
    for fold in folds_with_edges(dataset, "3-fold", tmp_path):
        own = {one.surface for one in fold.test if one.label is not None}
        for edge in (one for one in fold.test if one.label is None):
            assert set(edge.surface.split(" to ")) <= own
            assert not set(edge.surface.split(" to ")) & {one.surface for one in fold.train}


def test_splits_follow_what_the_data_tells(dataset: Dataset) -> None:
    assert splits_of(dataset) == ("leave-one-surface-out", "5-fold")
    assert splits_of(dataset, fast=True) == ("3-fold",)
    told = [replace(one, session=f"{k}", scenario="ab"[k % 2]) for k, one in enumerate(dataset.recordings)]
    with_sessions = replace(dataset, recordings=tuple(told))
    assert splits_of(with_sessions)[2:] == ("leave-one-scenario-out", "5-fold-by-session")


def test_simulated_sound_is_called_so(dataset: Dataset) -> None:
    assert origin_of(dataset) == "as recorded"
    told = replace(dataset.recordings[0], properties=MappingProxyType({"source": "simulated"}))
    assert origin_of(replace(dataset, recordings=(told,))) == "SIMULATED sound"


def test_who_takes_part(dataset: Dataset) -> None:
    names = [one.name for one in entries_for(dataset)]
    assert names[0] == "paper/general"
    assert names[-1] == "ours"
    assert set(names) == set(entry_names(2))
    with pytest.raises(ConfigError, match="no method guesswork"):
        entries_for(dataset, ["guesswork"])


def test_costs_are_measured_on_files_that_run(dataset: Dataset, tmp_path: Path) -> None:
    costs = measure_costs(dataset, ["level", "direct", AIR_DEAD, "ours"], tmp_path)
    assert set(costs) == {"level", "direct", "ours"}
    assert costs["direct"].parameters == 0
    assert costs["direct"].update_us > 0
    assert costs["ours"].parameters < 20_000
    assert cost_of(model_path("paper"), duration=0.5).parameters > 1_800_000


def test_the_page_stands_alone_and_tells_every_result(findings: Findings, tmp_path: Path, dataset: Dataset) -> None:
    results = findings.results
    page = write_page([findings], costs={dataset.name: measure_costs(dataset, ["level"], tmp_path)}, notes=["a <note>"])
    assert all(one.method in page for one in results)
    assert page.count("<svg") == 6
    assert "&lt;note&gt;" in page
    assert "labels dealt anew over the surfaces" in page
    assert "perceptual" in page
    assert "src=" not in page
    assert "@import" not in page
    assert len(row_of(results[0])) == len(COLUMNS)
    assert not math.isnan(results[0].bumps_per_minute)
