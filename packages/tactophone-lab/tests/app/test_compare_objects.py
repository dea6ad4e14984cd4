"""An operator compares two objects, from Python as by the command line."""

import json

import pytest

from tactophone.app.compare import Comparison
from tactophone.cli import main
from tactophone.core.settings import Settings, change
from tactophone_lab.app.compare_objects import compare_objects, record_two

QUICK = ["capture.source=finger", "simulation.gain_db=-20"]


@pytest.mark.slow
def test_the_verb_compares_as_python_does(capsys: pytest.CaptureFixture[str]) -> None:
    sounds = record_two(
        change(Settings(), QUICK), "polished marble", "lava stone", seconds=3.0
    )
    assert sounds.findings() == []
    found: Comparison = compare_objects(sounds, tip="pad")
    command = "setup --source finger --set simulation.gain_db=-20 --seconds 3 --yes"
    names = "polished marble, lava stone"
    assert main([*command.split(), "--json", "--compare", names]) == 0
    printed = json.loads(capsys.readouterr().out)
    assert printed["rougher"] == names.split(", ")[1]
    assert found.rougher == 1
    assert printed["certainty"] == pytest.approx(found.certainty)
