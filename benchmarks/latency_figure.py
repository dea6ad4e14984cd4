"""Draws docs/images/latency.svg from the table in docs/research/latency.md: p50 to p99
of each row, by period.

Run ``python benchmarks/latency_figure.py`` after the table has changed.
"""

import argparse
import re
from pathlib import Path

import matplotlib

matplotlib.use("svg")
import matplotlib.pyplot as plt

DOCS = Path(__file__).parent.parent / "docs"
LOOKAHEAD = 2.5
"""ms of Opus at low delay."""

ROWS = {
    (32, "Tactophone, PCM"): "32 samples, PCM",
    (64, "Tactophone, PCM"): "64 samples, PCM",
    (64, "Tactophone, Opus 2.5 ms"): "64 samples, Opus 2.5 ms",
    (64, "JackTrip, queue 2"): "JackTrip, 64 samples, queue 2",
    (64, "JackTrip, queue 4"): "JackTrip, 64 samples, queue 4, its default",
    (128, "Tactophone, PCM"): "the same, PCM",
    (
        128,
        "Tactophone, Opus 2.5 ms",
    ): "impulse to first vibration, 128 samples, Opus 2.5 ms",
    (128, "JackTrip, queue 2"): "JackTrip, 128 samples, queue 2",
    (128, "JackTrip, queue 4"): "JackTrip, 128 samples, queue 4, its default",
    (512, "Tactophone, PCM"): "512 samples, PCM of 128",
    (512, "Tactophone, Opus 10 ms"): "512 samples as in the paper, Opus 10 ms",
    (512, "JackTrip, queue 4"): "JackTrip, 512 samples, queue 4, its default",
}
"""Period and label of each bar, and the first cell of its row."""

_PALETTE = (
    DOCS.parent / "packages/tactophone/src/tactophone/core/palette.css"
).read_text()
COLOUR = dict(re.findall(r"--(\w+): (#\w+)", _PALETTE.partition("[data-theme")[0]))
COLOURS = {
    "Tactophone, PCM": COLOUR["contact"],
    "Tactophone, Opus": COLOUR["smooth"],
    "JackTrip": COLOUR["rough"],
}


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "folder",
        nargs="?",
        type=Path,
        default=DOCS / "images",
        help="where latency.svg is written (default: docs/images)",
    )
    folder = parser.parse_args().folder
    table = (DOCS / "research" / "latency.md").read_text()
    figure, axes = plt.subplots(figsize=(8, 5.2))
    labels, place, before = [], 0.0, 0
    for (period, name), cell in ROWS.items():
        p50, p99 = measured(table, cell)
        place += 1.0 if period == before else 1.6
        before = period
        colour = next(
            colour for start, colour in COLOURS.items() if name.startswith(start)
        )
        limit = 2 * period / 48 + LOOKAHEAD * ("Opus" in name)
        axes.plot(
            [p50, p99],
            [place, place],
            color=colour,
            linewidth=2.5,
            alpha=0.5,
            solid_capstyle="butt",
        )
        axes.plot(p50, place, "o", color=colour, markersize=7)
        axes.plot(
            p99,
            place,
            "o",
            color=colour,
            markersize=7,
            markerfacecolor="white",
            markeredgewidth=1.6,
        )
        axes.plot(
            limit, place, "|", color="#1c2127", markersize=13, markeredgewidth=1.6
        )
        axes.text(
            max(p99, limit) + 0.8,
            place,
            f"{p50:.1f} / {p99:.1f}",
            va="center",
            fontsize=9,
        )
        labels.append((place, f"{period} samples: {name}"))
    axes.set_yticks(
        [place for place, _ in labels], [label for _, label in labels], fontsize=9
    )
    axes.invert_yaxis()
    axes.set_xlim(0, None)
    axes.grid(axis="x", color="#e6e2d9")
    axes.set_axisbelow(True)
    axes.set_title("Impulse to first vibration", loc="left", fontsize=11)
    axes.set_xlabel(
        "ms: p50 (dot), p99 (ring); black mark: two periods and look-ahead", fontsize=9
    )
    axes.spines[["top", "right"]].set_visible(False)
    figure.tight_layout()
    # No date and fixed names, so that the file changes with the figures alone.
    matplotlib.rcParams["svg.hashsalt"] = "latency"
    figure.savefig(folder / "latency.svg", metadata={"Date": None})


def measured(table: str, cell: str) -> tuple[float, float]:
    """Return p50 and p99 in ms of the row that begins with a cell."""
    found = re.search(
        rf"^\| {re.escape(cell)} \|.*?p50 ([\d.]+), p95 [\d.]+, p99 ([\d.]+) ms",
        table,
        re.MULTILINE,
    )
    if found is None:
        raise SystemExit(
            f"docs/research/latency.md has no figures for {cell!r}: paste what "
            "latency.py prints"
        )
    return float(found[1]), float(found[2])


if __name__ == "__main__":
    main()
