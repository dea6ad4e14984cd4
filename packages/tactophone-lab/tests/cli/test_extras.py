"""A verb asks for what it and its options need before it computes anything."""

import importlib.util
from typing import Any

import pytest

from tactophone.cli import main

OF_OPTIONS = [
    (["feel", "NOWHERE.wav", "--plot"], "matplotlib", "tactophone[plot]"),
    (["dataset", "show", "NOWHERE", "--plot", "a.png"], "matplotlib", "[plot]"),
    (["evaluate", "--data", "NOWHERE"], "sklearn", "tactophone-lab[train]"),
    (
        ["evaluate", "--data", "NOWHERE", "--vary", "seed=0,1"],
        "sklearn",
        "tactophone-lab[train]",
    ),
    (["setup", "--source", "file:NOWHERE", "--yes"], "torch", "[train]"),
    (["evaluate", "--data", "NOWHERE", "--ray"], "ray", "tactophone-lab[ray]"),
]


@pytest.fixture
def missing(monkeypatch: pytest.MonkeyPatch) -> set[str]:
    """Names of modules that are not installed, for a test to fill."""
    names: set[str] = set()
    find = importlib.util.find_spec

    def find_others(name: str, *args: Any) -> Any:
        return None if name in names else find(name, *args)

    monkeypatch.setattr(importlib.util, "find_spec", find_others)
    return names


@pytest.mark.parametrize(("words", "module", "wanted"), OF_OPTIONS)
def test_an_option_asks_for_its_extra_first(
    words: list[str],
    module: str,
    wanted: str,
    missing: set[str],
    capsys: pytest.CaptureFixture[str],
) -> None:
    missing.add(module)
    assert main(words) == 1
    said = capsys.readouterr().err
    assert "NOWHERE" not in said
    assert f"{module} is not installed: pip install " in said
    assert wanted in said
