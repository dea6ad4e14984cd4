import argparse
import json
from multiprocessing.connection import Connection
from pathlib import Path
from types import SimpleNamespace
from typing import cast

import numpy as np
import pytest
from rich.text import Text

from tactophone.app.compare import Comparison
from tactophone.cli import main
from tactophone.cli.guide import GuidePage, GuideScreen
from tactophone.core.tips import DEFAULT_TIP
from tactophone.signal.perception.model_file import read_model
from tactophone.signal.perception.models import model_path
from tactophone_lab.app.setup import Fitted
from tactophone_lab.cli import setup
from tactophone_lab.cli.comparison import verdict
from tactophone_lab.cli.setup import _fitted
from tactophone_lab.training.finger_fit import (
    SHIPPED_BOUNDARY,
    Correction,
    LeftOut,
    SetUpFit,
)

QUICK = [
    "setup",
    "--source",
    "finger",
    "--set",
    "simulation.gain_db=-20",
    "--seconds",
    "3",
    "--yes",
]


@pytest.mark.slow
def test_a_simulated_finger_gets_a_model_of_its_own(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "own.onnx"
    assert main([*QUICK, "--out", str(path), "--json"]) == 0
    result = json.loads(capsys.readouterr().out)
    assert [object["rough"] for object in result["objects"]] == [
        False,
        False,
        True,
        True,
    ]
    assert result["tip"] == read_model(path).card.tip == "pad"
    assert read_model(path).card.gate.threshold_dbfs == pytest.approx(
        result["threshold_dbfs"], abs=0.01
    )


@pytest.mark.slow
def test_a_faulty_microphone_is_named_and_nothing_is_written(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "own.onnx"
    objects = ["--smooth", "whiteboard", "--rough", "brick"]
    assert (
        main(
            [
                *QUICK,
                *objects,
                "--set",
                "simulation.faults=contact-dead",
                "--out",
                str(path),
            ]
        )
        == 1
    )
    assert "contact microphone" in capsys.readouterr().out
    assert not path.exists()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("tip", "model"),
    [("plastic", "plastic"), ("stylus", "stylus"), ("rubber", "rubber")],
)
def test_the_model_to_start_from_is_the_shipped_one_for_the_tip(
    tip: str, model: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "own.onnx"
    objects = ["--smooth", "whiteboard", "--rough", "brick", "--tip", tip]
    gains = ["--set", "simulation.gain_db=-30", "--set", "simulation.air_gain_db=-30"]
    assert main([*QUICK, *gains, *objects, "--out", str(path), "--json"]) == 0
    assert json.loads(capsys.readouterr().out)["from"] == model
    assert read_model(path).card.tip == tip


@pytest.mark.slow
def test_a_tip_unlike_the_one_stated_is_said(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    objects = ["--smooth", "whiteboard", "--rough", "brick", "--model", "plastic"]
    assert main([*QUICK, *objects, "--out", str(tmp_path / "own.onnx"), "--json"]) == 0
    assert "sounds like a soft tip" in " ".join(
        json.loads(capsys.readouterr().out)["findings"]
    )


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--seconds", "1"], "must be 2 to 60 s"),
        (["--smooth", " , "], "name a smooth object"),
    ],
)
def test_a_wrong_option_is_one_line(
    arguments: list[str], words: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["setup", "--source", "finger", "--yes", *arguments]) == 1
    (line,) = capsys.readouterr().err.splitlines()
    assert words in line


@pytest.mark.slow
def test_a_model_of_another_kind_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    objects = ["--smooth", "whiteboard", "--rough", "brick", "--seconds", "2"]
    arguments = [
        *QUICK,
        *objects,
        "--model",
        str(model_path("paper")),
        "--out",
        str(tmp_path / "own.onnx"),
    ]
    assert main(arguments) == 1
    assert "has kind paper" in capsys.readouterr().err


def test_a_page_that_has_ended_leaves_the_command_to_the_terminal(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    class Ended:
        url = "http://127.0.0.1:0/"

        def __init__(self, orders: Connection) -> None:
            orders.close()

        def __exit__(self, *_: object) -> None:
            pass

    monkeypatch.setattr("tactophone.faces.web.server.serve_guide", Ended)
    with GuidePage(wait=True) as page:
        page.show(instruction="slide")
        assert not page.pressed()


@pytest.mark.parametrize(("right", "says"), [(0.1, True), (0.6, True), (0.9, False)])
def test_a_finger_that_no_model_fits_is_told_how_to_get_one(
    right: float, says: bool
) -> None:
    left_out = tuple(
        LeftOut(name, rough, right, right)
        for name, rough in (("tile", False), ("brick", True))
    )
    unchanged = Correction(np.zeros(1), np.ones(1), np.zeros(1), 1.0, 0.0)
    fitted = Fitted(
        Path("a.onnx"),
        SetUpFit(unchanged, SHIPPED_BOUNDARY, left_out),
        [],
        -40.0,
        "rubber",
        "rubber",
    )
    words = " ".join(
        str(part) for part in _fitted(fitted) if isinstance(part, str | Text)
    )
    assert ("no shipped model fits" in words) is says
    assert ("the wrong way round" in words) is (right == 0.1)
    assert words.endswith(
        "a.onnx; use it as --tip rubber --model of `feel` and `receive`"
    )


@pytest.mark.slow
def test_a_hand_needs_the_name_of_the_finger_to_set_up(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([*QUICK, "--fingers", "2", "--out", str(tmp_path / "own.onnx")]) == 1
    assert capsys.readouterr().err == (
        "tactophone: --fingers names thumb, index, but one finger is needed: add "
        "--finger thumb\n"
    )
    objects = ["--smooth", "whiteboard", "--rough", "brick"]
    for words in (["--fingers", "2", "--finger", "index"], ["--fingers", "1"]):
        assert (
            main([*QUICK, *objects, *words, "--out", str(tmp_path / "own.onnx")]) == 0
        )


def test_objects_that_nobody_named_are_their_owner_s_to_choose() -> None:
    parser = argparse.ArgumentParser()
    setup.add_arguments(parser)
    args = parser.parse_args([])
    own = setup.names_of(args, "rough", simulated=False)
    assert own == ["your first rough object", "your second rough object"]
    assert setup.names_of(args, "rough", simulated=True) == ["brick", "lava stone"]


def test_whoever_is_not_sure_of_the_tip_gets_the_setting(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    offered: dict[str, str] = {}

    def answer(_: object, __: str, buttons: dict[str, str], ___: str) -> str:
        offered.update(buttons)
        return setup.UNSURE

    monkeypatch.setattr(setup, "ask", answer)
    parser = argparse.ArgumentParser()
    setup.add_arguments(parser)
    args = parser.parse_args([])
    screen = SimpleNamespace(answers=True)
    assert setup.ask_tip(args, cast(GuideScreen, screen)) == DEFAULT_TIP
    assert offered[setup.UNSURE] == f"Not sure: take {DEFAULT_TIP}"


@pytest.mark.parametrize(
    ("probability", "seconds", "words"),
    [
        (0.98, 8.0, "rougher: slate, almost surely; in 98 %"),
        (0.12, 8.0, "rougher: glass, probably; in 88 %"),
        (0.8, 8.0, "not sure which is rougher: simulated pairs that differ"),
        (0.5, 0.4, "not sure which is rougher: 0.4 s of touch was heard on glass"),
    ],
)
def test_a_comparison_says_what_is_rougher_how_sure_or_what_to_do(
    probability: float, seconds: float, words: str
) -> None:
    found = Comparison((1.0, -1.0), (8.0, seconds), probability)
    assert verdict(found, ("slate", "glass")).startswith(words)


@pytest.mark.parametrize("given", ["slate", "slate, glass, brick"])
def test_two_objects_are_compared(
    given: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main([*QUICK, "--compare", given]) == 1
    (line,) = capsys.readouterr().err.splitlines()
    assert "two are compared: name them as in --compare slate,glass" in line


def test_what_is_compared_has_no_label(capsys: pytest.CaptureFixture[str]) -> None:
    assert main([*QUICK, "--compare", "slate,glass", "--smooth", "glass"]) == 1
    assert "leave out --smooth and --rough" in capsys.readouterr().err


@pytest.mark.slow
def test_a_faulty_microphone_is_named_and_nothing_is_compared(
    capsys: pytest.CaptureFixture[str],
) -> None:
    dead = ["--set", "simulation.faults=contact-dead"]
    assert main([*QUICK, *dead, "--compare"]) == 1
    assert "nothing was compared" in capsys.readouterr().out
