"""Writes the tables of docs/reference/paper.md from the points in paper.toml: ``python
scripts/paper_page.py``."""

import argparse
import re
import sys
import tomllib
from collections import Counter
from pathlib import Path

PAGE = Path(__file__).parents[1] / "docs" / "reference" / "paper.md"
HEAD = "| # | the paper | here | command | state |\n|--:|---|---|---|---|\n"
KINDS = ("works", "partly", "no")


def points() -> list[dict[str, str]]:
    """Return all points; each state begins with one of `KINDS`."""
    found: list[dict[str, str]] = tomllib.loads(
        PAGE.with_suffix(".toml").read_text(encoding="utf-8")
    )["point"]
    for point in found:
        if kind(point) not in KINDS:
            raise ValueError(
                f"point {point['number']}: state {point['state']!r} must begin with "
                f"{', '.join(KINDS)}"
            )
    return found


def kind(point: dict[str, str]) -> str:
    return re.split(r"\W", point["state"])[0]


def written(page: str) -> str:
    """Return the page with each section's table and the count made anew."""
    rows = points()
    for section in dict.fromkeys(row["section"] for row in rows):
        cells = ("number", "paper", "here", "command", "state")
        own = (row for row in rows if row["section"] == section)
        table = HEAD + "".join(
            "| " + " | ".join(str(row[cell]) for cell in cells) + " |\n" for row in own
        )
        begin = page.index(f"## {section}\n")
        start = page.index("| # |", begin)
        end = page.index("\n\n", start) + 1
        page = page[:start] + table + page[end:]
    count = Counter(kind(row) for row in rows)
    words = (
        f"Of {len(rows)} points {count['works']} work, {count['partly']} work "
        f"partly and {count['no']} do not."
    )
    return re.sub(r"Of \d+ points [^.]*\.", words, page)


def main() -> None:
    argparse.ArgumentParser(description=__doc__).parse_args()
    PAGE.write_text(written(PAGE.read_text(encoding="utf-8")), encoding="utf-8")
    sys.stdout.write(f"{PAGE}\n")


if __name__ == "__main__":
    main()
