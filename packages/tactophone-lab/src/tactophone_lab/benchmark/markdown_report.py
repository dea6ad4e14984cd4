"""The benchmark's report: Markdown with its tables, and its figures as SVG files beside
it."""

import math
from collections.abc import Iterable, Mapping, Sequence
from itertools import groupby
from pathlib import Path
from typing import Any

import numpy as np

from tactophone.app.figures import (
    BLUE,
    GREEN,
    GREY,
    VERMILION,
    as_shown,
    load_pyplot,
    save_figure,
)
from tactophone.core.processes import make_room
from tactophone.signal.haptics.profiles import (
    PROFILES,
    discriminable_steps,
    open_profile,
)
from tactophone_lab.benchmark.results import DatasetResults, MethodResult
from tactophone_lab.evaluation.bumps_and_delays import HALF

REPORT_COLUMNS = (
    "method",
    "balanced accuracy as rendered",
    "smooth as rough",
    "time wrong",
    "gaps",
    "windows: balanced accuracy",
    "AUC",
    "recall at 1 %",
    "false positives",
    "at the reference's recall",
    "false bumps a minute",
    "contact, ms: p50 / p95 (never)",
    "edge, ms: p50 / p95 (never)",
    "calibration error",
    "p (corrected)",
)

COLOURS: Mapping[str, str] = {
    "texture": VERMILION,
    "paper/general": BLUE,
    "level": GREEN,
}
"""Of the methods that figures name: what ships, the paper's and the
least. Others are grey."""

MOST_CELLS = 20
"""Surfaces in a figure whose cells still hold a legible number."""


def write_report(
    folder: Path, datasets: Sequence[DatasetResults], *, notes: Iterable[str]
) -> Path:
    """Write ``report.md`` with its figures beside it; ``notes`` are paragraphs at the
    top: what ran, on what."""
    parts = ["# Tactophone benchmark", *notes]
    for of_dataset in datasets:
        parts.append(f"## {of_dataset.dataset}: {of_dataset.origin}")
        for split, results in groupby(
            of_dataset.results, key=lambda result: result.split
        ):
            parts += _section(folder, list(results), split, of_dataset)
    steps = [
        (name, f"{pitch:.1f}", f"{both:.1f}")
        for name, (pitch, both) in steps_by_profile().items()
    ]
    parts += [
        "## Rendering profiles",
        "Just-noticeable steps between smooth and rough (18 % of frequency, 1.5 dB).",
        _table(("profile", "steps of frequency", "steps with level"), steps),
    ]
    path = folder / "report.md"
    make_room(path)
    path.write_text("\n\n".join(parts) + "\n", encoding="utf-8")
    return path


def _section(
    folder: Path,
    results: Sequence[MethodResult],
    split: str,
    of_dataset: DatasetResults,
) -> list[str]:
    figures = {"scores": draw_scores(results), "curves": draw_curves(results)}
    if any(
        math.isfinite(result.contact_ms[0]) or math.isfinite(result.edge_ms[0])
        for result in results
    ):
        figures["delays"] = draw_delays(results)
    figures["surfaces"] = draw_surfaces(results)
    rules = [
        (rule, name)
        for rule in ("authors", "two-class")
        for name in ("balanced", "smooth", "rough")
    ]
    accuracies = [
        (
            result.method,
            *(str(result.scores[rule][f"{name}_accuracy"]) for rule, name in rules),
        )
        for result in results
    ]
    return [
        f"### {split}",
        "As rendered (gate, abstention, decision rule inside); windows in true "
        "contact, two-class rule.",
        _table(REPORT_COLUMNS, [row_of(result) for result in results]),
        f"The {control_of(of_dataset, split)}.",
        "Accuracy by both rules; by the authors', a prediction none counts as smooth.",
        _table(("method", *(f"{rule}: {name}" for rule, name in rules)), accuracies),
        *(
            _save(figure, folder / f"{of_dataset.dataset}-{split}-{name}.svg")
            for name, figure in figures.items()
        ),
    ]


def control_of(results: DatasetResults, split: str) -> str:
    """Say what the control of a split scored."""
    accuracies = ", ".join(f"{value:.2f}" for value in results.permuted[split])
    return f"control, permuted labels: balanced accuracy {accuracies}"


def row_of(result: MethodResult) -> tuple[str, ...]:
    """Return the cells of a result, in the order of :data:`REPORT_COLUMNS`."""
    scores = result.scores["two-class"]
    difference = result.differences.get("balanced_accuracy")
    rendered = result.rendered
    return (
        result.method,
        str(rendered.balanced_accuracy),
        *(
            _number(share.value, ".3f")
            for share in (rendered.smooth_as_rough, rendered.wrong, rendered.gaps)
        ),
        str(scores["balanced_accuracy"]),
        str(scores["auc"]),
        str(scores["recall_at_1"]),
        _number(scores["false_positive_rate"].value, ".3f"),
        _number(result.false_positives_at_reference, ".3f"),
        _number(result.bumps_per_minute, ".1f"),
        format_delay(result.contact_ms),
        format_delay(result.edge_ms),
        _number(result.calibration_error, ".3f"),
        f"{_number(difference.p, '.3f')} ({_number(difference.corrected, '.3f')})"
        if difference
        else "-",
    )


def format_delay(delay: tuple[float, float, float]) -> str:
    """Format a delay in ms: p50 and p95 of all changes, and the share without a correct
    decision.

    >>> format_delay((95.0, float("inf"), 0.2))
    '95 / never (20 %)'
    >>> format_delay((82.4, 179.6, 0.04))
    '82 / 180 (4 %)'
    >>> format_delay((math.nan, math.nan, math.nan))
    '-'
    """
    p50, p95, missed = delay
    if math.isnan(p50):
        return "-"
    times = (
        f"{time_ms:.0f}" if math.isfinite(time_ms) else "never"
        for time_ms in (p50, p95)
    )
    return f"{' / '.join(times)} ({100 * missed:.0f} %)"


def steps_by_profile() -> dict[str, tuple[float, float]]:
    """Return the number of just-noticeable steps from smooth to rough, of frequency and
    in all, by profile."""
    return {name: discriminable_steps(open_profile(name)) for name in PROFILES}


def _table(heading: Sequence[str], rows: Sequence[Sequence[str]]) -> str:
    rule = ("---", *("--:" for _ in heading[1:]))
    return "\n".join(f"| {' | '.join(cells)} |" for cells in (heading, rule, *rows))


def _number(value: float, form: str) -> str:
    return "-" if math.isnan(value) else format(value, form)


def _save(figure: Any, path: Path) -> str:
    pyplot = load_pyplot()
    with pyplot.rc_context({"svg.hashsalt": "tactophone", "svg.fonttype": "none"}):
        save_figure(figure, path, format="svg", metadata={"Date": None})
    return f"![{path.stem}](<{path.name}>)"


def draw_scores(results: Sequence[MethodResult]) -> Any:
    """Draw balanced accuracy of every method with its interval, best on top."""
    pyplot = load_pyplot()
    rows = sorted(
        results,
        key=lambda result: result.scores["two-class"]["balanced_accuracy"].value,
    )
    figure, axis = pyplot.subplots(
        figsize=(7.2, 0.9 + 0.3 * len(rows)), layout="constrained"
    )
    for place, result in enumerate(rows):
        score = result.scores["two-class"]["balanced_accuracy"]
        colour = COLOURS.get(result.method, GREY)
        axis.plot(
            [score.low, score.high],
            [place, place],
            color=colour,
            linewidth=2.2,
            alpha=0.55,
        )
        axis.plot(score.value, place, "o", color=colour, markersize=6)
    axis.axvline(0.5, color=GREY, linewidth=0.8, linestyle=(0, (4, 4)))
    axis.text(0.502, len(rows) - 0.4, "chance", color="#555555", fontsize=8)
    axis.set(
        yticks=range(len(rows)),
        yticklabels=[result.method for result in rows],
        ylim=(-0.6, len(rows) - 0.1),
    )
    axis.set_xlabel("balanced accuracy per update (90 % interval over surfaces)")
    return figure


def draw_curves(results: Sequence[MethodResult]) -> Any:
    """Draw the ROC curves on a log axis, because low false positive rates matter."""
    pyplot = load_pyplot()
    figure, axis = pyplot.subplots(figsize=(7.2, 4.2), layout="constrained")
    places = list[tuple[float, MethodResult]]()
    for result in results:
        rate, recall = np.array(result.curve).T
        if colour := COLOURS.get(result.method):
            axis.plot(100 * rate, recall, color=colour, linewidth=2.4, zorder=3)
            places.append((float(np.interp(0.01, rate, recall)), result))
        else:
            axis.plot(100 * rate, recall, color="#c4c4c4", linewidth=0.8, zorder=2)
    # Each name over its curve at 1 %; those that would touch are moved up.
    height = -1.0
    for recall_here, result in sorted(places, key=lambda each: each[0]):
        height = max(recall_here + 0.03, height + 0.065)
        ground = {"facecolor": "white", "edgecolor": "none", "pad": 1.0, "alpha": 0.85}
        axis.text(
            0.93,
            height,
            result.method,
            color=COLOURS[result.method],
            fontsize=9,
            ha="right",
            bbox=ground,
            zorder=4,
        )
    axis.axvline(1.0, color=GREY, linewidth=0.8, linestyle=(0, (4, 4)))
    axis.set(
        xscale="log",
        xlim=(0.1, 100),
        ylim=(0, 1),
        xticks=(0.1, 1, 10, 100),
        ylabel="rough updates found",
    )
    axis.set_xticklabels(("0.1", "1", "10", "100"))
    axis.set_xlabel("smooth updates classified as rough (%)")
    axis.set_title(
        f"grey: {len(results) - len(places)} other methods",
        loc="right",
        fontsize=9,
        color="#555555",
    )
    return figure


def draw_delays(results: Sequence[MethodResult]) -> Any:
    """Draw the time to a correct decision after contact and after an edge: p50 to
    p95."""
    pyplot = load_pyplot()
    rows = [
        each
        for each in reversed(results)
        if np.isfinite((each.contact_ms[0], each.edge_ms[0])).any()
    ]
    figure, axes = pyplot.subplots(
        1, 2, sharey=True, figsize=(8.2, 0.9 + 0.27 * len(rows)), layout="constrained"
    )
    for axis, event in zip(axes, ("contact", "edge"), strict=True):
        for place, result in enumerate(rows):
            _draw_delay(
                axis,
                place,
                getattr(result, f"{event}_ms"),
                colour=COLOURS.get(result.method, GREY),
            )
        axis.axvline(100, color=GREY, linewidth=0.7, linestyle=(0, (4, 4)))
        axis.set(
            xlabel=f"ms from {event} to a correct decision: p50, p95", xlim=(0, None)
        )
        axis.margins(x=0.25)
    names = [result.method for result in rows]
    axes[0].set(
        yticks=range(len(rows)), yticklabels=names, ylim=(-0.6, len(rows) - 0.4)
    )
    return figure


def _draw_delay(
    axis: Any, place: int, delay: tuple[float, float, float], *, colour: str
) -> None:
    p50, p95, missed = delay
    if not np.isfinite(p50):
        return
    # A p95 that never comes reaches as far as joined edges do, with an arrow.
    end, marker = (p95, "|") if np.isfinite(p95) else (1e3 * HALF, ">")
    axis.plot([p50, end], [place, place], color=colour, linewidth=2.2, alpha=0.55)
    axis.plot(p50, place, "o", color=colour, markersize=5)
    axis.plot(end, place, marker, color=colour, markersize=9 if marker == "|" else 4)
    axis.annotate(
        f"never: {missed:.0%}",
        (end, place),
        xytext=(6, 0),
        textcoords="offset points",
        fontsize=8,
        va="center",
        color="#555555",
    )


def draw_surfaces(results: Sequence[MethodResult]) -> Any:
    pyplot = load_pyplot()
    names = sorted(
        results[0].by_surface, key=lambda name: (results[0].by_surface[name], name)
    )
    shares = np.array(
        [
            [100 * result.by_surface.get(name, np.nan) for name in names]
            for result in results
        ]
    )
    figure, axis = pyplot.subplots(
        figsize=(7.2, 1.6 + 0.24 * len(results)), layout="constrained"
    )
    image = axis.imshow(shares, cmap="cividis", vmin=0, vmax=100, aspect="auto")
    for row, column in np.ndindex(shares.shape) if len(names) <= MOST_CELLS else ():
        ink = "white" if shares[row, column] < 60 else "black"
        axis.text(
            column,
            row,
            f"{shares[row, column]:.0f}",
            ha="center",
            va="center",
            fontsize=8,
            color=ink,
        )
    axis.set_xticks(
        range(len(names)),
        [*map(as_shown, names)],
        rotation=60,
        ha="right",
        rotation_mode="anchor",
        fontsize=8,
    )
    axis.set_yticks(
        range(len(results)), [result.method for result in results], fontsize=8
    )
    axis.tick_params(length=0)
    figure.colorbar(image, label="updates classified correctly (%)", pad=0.01)
    return figure
