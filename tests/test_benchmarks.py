"""`make benchmarks-smoke` runs every script of benchmarks/, and its page names each."""

import re
from pathlib import Path

import pytest

from benchmarks.cells import in_ms
from benchmarks.smoke import PARTS, SETTINGS, Inputs

FOLDER = Path(__file__).parents[1] / "benchmarks"
SCRIPTS = {
    path.stem
    for path in FOLDER.glob("*.py")
    if 'if __name__ == "__main__":\n' in path.read_text(encoding="utf-8")
}


def test_every_script_has_a_small_setting() -> None:
    assert len(SCRIPTS) > 30
    assert {*SETTINGS, *PARTS} == SCRIPTS


def test_every_input_of_a_small_setting_is_one_that_is_made(tmp_path: Path) -> None:
    known = Inputs(tmp_path).names
    for commands in SETTINGS.values():
        for command in commands:
            assert set(re.findall(r"{([\w-]+)}", command)) <= known, command


def test_the_page_of_the_benchmarks_names_every_script() -> None:
    page = (FOLDER / "README.md").read_text(encoding="utf-8")
    named = set(re.findall(r"`(\w+)\.py`", page))
    assert {path.stem for path in FOLDER.glob("*.py")} <= named


@pytest.mark.parametrize(
    ("milliseconds", "words"),
    [(12.4, "12 ms"), (float("inf"), "never"), (float("nan"), "-")],
)
def test_a_time_that_never_comes_is_said_in_words(
    milliseconds: float, words: str
) -> None:
    assert in_ms(milliseconds) == words


def test_edges_of_which_none_is_reported_have_a_row() -> None:
    """The script once ended with a traceback where a set has no edge."""
    edges = pytest.importorskip("benchmarks.edges")
    assert edges.cells_of([], None) == [
        "0",
        "-",
        "-",
        "0",
        "-",
        "-, 0 of 0",
        "-, 0 of 0",
    ]


@pytest.mark.parametrize("trees", [["now"], ["now", "before"]])
def test_rows_of_versions_have_a_cell_for_each_column(trees: list[str]) -> None:
    """With one version, its table once had a column without a name."""
    versions = pytest.importorskip("benchmarks.versions")
    case = versions.Case("air", 1, 5.0)
    found = {(case, tree): [versions.Cost(10.0, 20.0, 1.0)] for tree in trees}
    lines = list(versions.table(found, trees, [case]))
    assert len({line.count("|") for line in lines}) == 1
    assert "|  |" not in lines[0]
