"""Inputs that once crashed a parser, for ever; and a short search for new ones."""

import contextlib
from pathlib import Path

import pytest

from . import TARGETS
from .__main__ import attack

CRASHES = Path(__file__).parent.parent / "data" / "crashes"
SMOKE = 30.0
"""Seconds of random inputs, for all targets together."""

OPEN = {"cards": "a card nested 100,000 deep is refused by `read_model`, not by `ModelCard.from_json`"}
"""Targets with crashes that are known and not mended yet."""


def _target(name: str, *values: object) -> object:
    marks = [pytest.mark.xfail(reason=OPEN[name], strict=False)] if name in OPEN else []
    return pytest.param(name, *values, marks=marks, id="-".join(map(str, (name, *(v.stem for v in values)))))  # type: ignore[attr-defined]


@pytest.mark.parametrize(
    ("name", "path"), [_target(path.parent.name, path) for path in sorted(CRASHES.glob("*/*.bin"))]
)
def test_an_input_that_once_crashed_a_parser_raises_what_is_documented(name: str, path: Path) -> None:
    _, run = TARGETS[name].prepare()
    with contextlib.suppress(*TARGETS[name].documented):
        run(path.read_bytes())


@pytest.mark.slow
@pytest.mark.parametrize("name", [_target(name) for name in TARGETS])
def test_random_inputs_crash_no_parser(name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    assert attack(name, SMOKE / len(TARGETS), seed=1) == 0


def test_every_golden_file_belongs_to_a_target() -> None:
    assert {path.name for path in CRASHES.iterdir() if path.is_dir()} <= TARGETS.keys()
