"""Whatever is known of a tip derives from its row in `core.tips.TIPS`."""

from types import MappingProxyType

import numpy as np
import pytest

from tactophone.core import tips
from tactophone.core.tips import TIPS, TipProperties, tip_picture
from tactophone.signal.perception import events, fit, models
from tactophone.signal.perception.model_file import read_model
from tactophone_lab.simulation import finger
from tactophone_lab.training.sets import HARD_TIPS

FIFTH = TipProperties(
    "brush", "a brush of nylon", "stylus", True, True, 40.0, TIPS["stylus"].picture
)


@pytest.fixture(params=[*TIPS, "brush"])
def tip(
    request: pytest.FixtureRequest, monkeypatch: pytest.MonkeyPatch
) -> TipProperties:
    """Each tip, and a fifth one that has nothing but its row."""
    table = (
        MappingProxyType({**TIPS, "brush": FIFTH}) if request.param == "brush" else TIPS
    )
    for module in (tips, events, fit, models):
        monkeypatch.setattr(module, "TIPS", table)
    return table[request.param]


def test_a_row_is_enough_for_model_events_and_expected_sound(
    tip: TipProperties,
) -> None:
    assert models.default_model(tip.name) == tip.model
    assert not models.tip_mismatch(
        read_model(models.model_path(tip.model)).card, tip.name
    )
    events.EventDetector(sample_rate=48_000, channels=2, tip=tip.name)
    check = fit.FitCheck(tip.model, 16_000, tip=tip.name)
    for _ in range(4 * fit.FIT_SPACING):
        check.push(
            np.random.default_rng(0).normal(0, 0.1, (2, 512)).astype(np.float32),
            touching=True,
        )


def test_the_picture_has_a_column_of_eight_lines_for_each_tip(
    tip: TipProperties,
) -> None:
    assert len(tip.picture) == 8
    assert all(len(line) < 18 for line in tip.picture)
    assert f" {tip.name}" in tip_picture()


def test_every_tip_has_its_mechanics_and_its_words_in_the_simulator() -> None:
    assert [*finger.TIPS] == [*TIPS]
    assert {name for name, each in TIPS.items() if each.hard} == set(HARD_TIPS)
