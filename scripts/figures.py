#!/usr/bin/env python3
"""Writes measured figures into the pages that state them, each from one place.

A page marks a figure with comments that no reader sees:
``<!--fig:NAME-->0.79<!--/-->``. Its value stands in ``docs/figures.toml``, with what it
is and the command that measures it, or in the card of a shipped model. After a new
measurement, change it there and run

    python scripts/figures.py

An entry may have a ``phrase``, a regular expression of the words in which pages state
the figure, as "gained N points": a test then finds a page that states it by hand.

``--check`` writes nothing, and ends with 1 where a page states another value.
"""

import argparse
import re
import tomllib
from collections.abc import Iterator, Mapping
from pathlib import Path

from tactophone.signal.perception.model_file import read_model
from tactophone.signal.perception.models import model_path

ROOT = Path(__file__).parent.parent
FIGURES = ROOT / "docs" / "figures.toml"
MARKED = re.compile(r"(<!--fig:(?P<name>[\w.-]+)-->)(?P<value>.*?)(<!--/-->)")


def values() -> dict[str, str]:
    """Return every figure by its name, as pages print it."""
    found = {}
    for name, entry in tomllib.loads(FIGURES.read_text(encoding="utf-8")).items():
        found[name] = entry["value"] if "value" in entry else from_card(entry)
    return found


def phrases() -> dict[str, re.Pattern[str]]:
    """Return the words in which pages state a figure, by its name."""
    entries = tomllib.loads(FIGURES.read_text(encoding="utf-8"))
    return {
        name: re.compile(entry["phrase"])
        for name, entry in entries.items()
        if "phrase" in entry
    }


def from_card(entry: Mapping[str, str]) -> str:
    """Return a score of a shipped model's card, to two digits."""
    card = read_model(model_path(entry["model"])).card
    return f"{card.scores[entry['set']][entry['score']][0]:.2f}"


def pages() -> Iterator[Path]:
    """Yield the pages that may state a figure."""
    yield ROOT / "README.md"
    yield from sorted((ROOT / "docs").rglob("*.md"))
    yield ROOT / "docs" / "reference" / "paper.toml"


def with_figures(text: str, figures: Mapping[str, str]) -> str:
    """Return a page with the value of each figure that it marks.

    Raises `KeyError` if it marks one that is not known.
    """
    return MARKED.sub(lambda mark: f"{mark[1]}{figures[mark['name']]}{mark[4]}", text)


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--check", action="store_true", help="write nothing")
    options = parser.parse_args()
    figures, stale = values(), []
    for page in pages():
        text = page.read_text(encoding="utf-8")
        fresh = with_figures(text, figures)
        if fresh != text:
            stale.append(page.relative_to(ROOT).as_posix())
            if not options.check:
                page.write_text(fresh, encoding="utf-8")
    print(*stale, sep="\n")
    return int(options.check and bool(stale))


if __name__ == "__main__":
    raise SystemExit(main())
