from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tactophone.core.errors import DatasetError, ModelError
from tactophone.core.recordings.values import Dataset, Recording
from tactophone.core.types import Touch
from tactophone.signal.perception.model_file import Gate, read_model
from tactophone_lab.datasets.open import open_dataset
from tactophone_lab.training.finetuning import (
    FinetuningData,
    finetuning_recipe,
    hold_out,
    mixtures,
    thinned,
    train_on_both,
    write_finetuned,
)
from tactophone_lab.training.onnx_export import make_card, read_weights, write_model
from tactophone_lab.training.paper_network import PaperNetwork, weights_of
from tests.folders import audiofolder
from tests.signal.perception.test_calibration_file import CALIBRATION

QUIET = replace(CALIBRATION, threshold_dbfs=-55.0, window_dbfs=-60.0)


def recordings(surfaces: int, takes: int) -> Dataset:
    takes_made = [
        Recording(
            Path(f"{surface}-{take}.wav"),
            f"stone {surface}",
            Touch.SMOOTH,
            take=str(take),
        )
        for surface in range(surfaces)
        for take in range(takes)
    ]
    return Dataset("new", Path(), tuple(takes_made))


def test_a_third_of_each_objects_takes_is_held_out() -> None:
    kept, out = hold_out(recordings(2, 7))
    assert len(kept) == 10
    assert [take.take for take in out] == ["1", "4", "1", "4"]
    assert not set(kept) & set(out)


@pytest.mark.parametrize(
    ("surfaces", "takes", "message"), [(1, 7, "two or more"), (3, 1, "one take only")]
)
def test_too_few_recordings_are_an_error(
    surfaces: int, takes: int, message: str
) -> None:
    with pytest.raises(DatasetError, match=message):
        hold_out(recordings(surfaces, takes))


def test_thinning_draws_over_all_surfaces() -> None:
    kept = thinned(recordings(5, 8).recordings, 10)
    assert len(kept) == 10
    assert len({take.surface for take in kept}) == 5
    assert len(thinned(recordings(2, 2).recordings, 10)) == 4


def model(folder: Path, kind: str = "paper") -> Path:
    weights = weights_of(PaperNetwork())
    card = make_card(weights, name="general", gate=Gate(-60.0))
    write_model(
        folder / "general.onnx",
        replace(card, kind=kind, training={"dataset": "stones"}),
        weights,
    )
    return folder / "general.onnx"


def test_mixtures_lie_between_the_old_and_the_new_network(tmp_path: Path) -> None:
    start = model(tmp_path)
    made = open_dataset(audiofolder(tmp_path / "stones")).recordings
    data = FinetuningData(made[:4], made[4:6], made[4:], made[:2], made[:2])
    job = finetuning_recipe(start, "blend", calibration=QUIET)
    job = replace(job, settings=replace(job.settings, least_steps=2, hop=64))
    trained = train_on_both(job, data)
    mixed = dict(mixtures(start, trained, "blend"))
    assert list(mixed) == [0.5, 0.25]
    before = read_weights(start)
    middle = (before["layer1.weight"] + trained["layer1.weight"]) / 2
    np.testing.assert_allclose(mixed[0.5]["layer1.weight"], middle, atol=1e-6)
    write_finetuned(tmp_path / "a.onnx", job, mixed[0.5], facts={"strategy": "blend"})
    card = read_model(tmp_path / "a.onnx").card
    assert card.training["dataset"] == "stones"
    assert card.training["finetuned"] == {"from": "general", "strategy": "blend"}
    assert card.gate == Gate(QUIET.threshold_dbfs)


def test_the_papers_strategy_has_its_threshold_and_mixes_nothing(
    tmp_path: Path,
) -> None:
    start = model(tmp_path)
    job = finetuning_recipe(start, "fine-tuned", calibration=QUIET)
    assert job.settings.labelling.relative
    trained = read_weights(start)
    assert [share for share, _ in mixtures(start, trained, "fine-tuned")] == [1.0]


def test_both_labels_and_kind_paper_are_required(tmp_path: Path) -> None:
    one_label = recordings(3, 2).recordings
    with pytest.raises(DatasetError, match="one label only"):
        train_on_both(
            finetuning_recipe(model(tmp_path), "blend"),
            FinetuningData(one_label, (), (), (), ()),
        )
    with pytest.raises(ModelError, match="kind texture"):
        finetuning_recipe(model(tmp_path, "texture"), "blend")
