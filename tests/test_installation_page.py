"""The page on installation names each verb and each extra under the package that
brings it."""

import re
import tomllib
from pathlib import Path

import pytest

from tactophone.cli.verbs import LABORATORY, OWN
from tactophone.core.extras import REQUIREMENT_OF_MODULE
from tactophone_lab.cli import VERBS

ROOT = Path(__file__).parent.parent
PAGE = (ROOT / "docs/guide/installation.md").read_text()
CODE = re.compile(r"`([a-z-]+)`")


def section(heading: str) -> str:
    """Return the lines between a heading or sentence of the page and the next one."""
    return PAGE.partition(f"{heading}\n\n")[2].partition("\n\n")[0]


def first_column(table: str) -> set[str]:
    """Return what stands as code in the first column of a Markdown table."""
    rows = table.splitlines()
    return {name for row in rows for name in CODE.findall(row.split("|")[1])}


@pytest.mark.parametrize(
    ("package", "verbs"),
    [
        ("tactophone", {verb.name for verb in OWN}),
        ("tactophone-lab", {verb.name for verb in VERBS}),
    ],
)
def test_each_verb_is_listed_under_its_package(package: str, verbs: set[str]) -> None:
    table = section(f"Verbs of `{package}`:")
    assert first_column(table) == verbs


def test_each_verbs_row_names_the_extras_that_it_always_needs() -> None:
    rows = [line.split("|") for line in PAGE.splitlines() if line.startswith("| `")]
    for verb in (*OWN, *VERBS):
        needed = next(row[3] for row in rows if f"`{verb.name}`" in row[1])
        assert set(verb.extras) <= set(CODE.findall(needed)), verb.name


def test_the_telephone_knows_every_verb_that_the_laboratory_adds() -> None:
    assert set(LABORATORY) == {verb.name for verb in VERBS}


@pytest.mark.parametrize("package", ["tactophone", "tactophone-lab"])
def test_each_extra_is_listed_under_its_package(package: str) -> None:
    project = ROOT / "packages" / package / "pyproject.toml"
    extras = tomllib.loads(project.read_text())["project"]["optional-dependencies"]
    assert first_column(section(f"Extras of `{package}`:")) == extras.keys()
    named = {
        extra for owner, extra in REQUIREMENT_OF_MODULE.values() if owner == package
    }
    assert named == extras.keys() - {"all"}
