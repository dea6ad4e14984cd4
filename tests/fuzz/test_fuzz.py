"""Inputs that once crashed a parser, for ever; and a short search for new ones."""

import contextlib
from pathlib import Path

import pytest

from . import TARGETS
from .__main__ import attack

CRASHES = Path(__file__).parent.parent / "data" / "crashes"
SMOKE = 5.0
"""Seconds of random inputs, for all targets together; `make fuzz` searches for long."""


@pytest.mark.parametrize(
    ("name", "path"),
    [
        pytest.param(path.parent.name, path, id=f"{path.parent.name}-{path.stem}")
        for path in sorted(CRASHES.glob("*/*.bin"))
    ],
)
def test_an_input_that_once_crashed_a_parser_raises_what_is_documented(
    name: str, path: Path
) -> None:
    _, run = TARGETS[name].prepare()
    with contextlib.suppress(*TARGETS[name].documented):
        run(path.read_bytes())


@pytest.mark.slow
@pytest.mark.parametrize("name", TARGETS)
def test_random_inputs_crash_no_parser(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    assert attack(name, TARGETS[name], SMOKE / len(TARGETS), seed=1) == 0


def test_every_golden_file_belongs_to_a_target() -> None:
    assert {path.name for path in CRASHES.iterdir() if path.is_dir()} <= TARGETS.keys()
