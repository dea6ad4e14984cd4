"""The benchmark's report: one HTML file that holds its tables and figures, and loads nothing."""

import html
import math
from collections.abc import Iterable, Mapping, Sequence
from itertools import groupby

from tactophone.benchmark.costs import Cost
from tactophone.benchmark.figures import (
    draw_curves,
    draw_delays,
    draw_heights,
    draw_reliability,
    draw_scores,
    draw_surfaces,
)
from tactophone.benchmark.height_regression import Heights
from tactophone.benchmark.plan import DatasetResults
from tactophone.benchmark.result import MethodResult
from tactophone.haptics import PROFILES, discriminable_steps, open_profile

COLUMNS = (
    "method", "balanced accuracy as rendered", "smooth as rough", "time wrong", "gaps", "windows: balanced accuracy",
    "AUC", "recall at 1 %", "false positives", "at the reference's recall", "false bumps a minute",
    "contact, ms: p50 / p95 (never)", "edge, ms: p50 / p95 (never)", "calibration error",
    "rank with Ra", "p (corrected)",
)  # fmt: skip

_STYLE = """
:root { color-scheme: light dark; --rule: #ccc; --soft: #f4f4f4; --best: #fde9df; }
@media (prefers-color-scheme: dark) {
  :root { --rule: #555; --soft: #222; --best: #4a2a1a; } .figure { background: #fff; }
}
body { font: 15px/1.5 system-ui, sans-serif; max-width: 88rem; margin: 2rem auto; padding: 0 1rem; }
h2 { margin-top: 3rem; border-bottom: 1px solid var(--rule); } caption { text-align: left; padding: .4rem 0; }
.scroll { overflow-x: auto; } table { border-collapse: collapse; font-size: 12.5px; }
th, td { padding: .3rem .45rem; text-align: right; border-bottom: 1px solid var(--rule); white-space: nowrap; }
th { vertical-align: bottom; white-space: normal; background: var(--soft); }
th:first-child, td:first-child { text-align: left; }
tr.texture { background: var(--best); } tr.control { font-style: italic; opacity: .75; }
.figures { display: flex; flex-wrap: wrap; gap: 1rem; align-items: flex-start; }
.figure { padding: .5rem; flex: 1 1 34rem; max-width: 46rem; } .figure svg { width: 100%; height: auto; }
"""


def write_report(
    datasets: Sequence[DatasetResults], *, costs: Mapping[str, Mapping[str, Cost]], notes: Iterable[str]
) -> str:
    """Return the report as HTML; ``notes`` are paragraphs at the top: what ran, on what."""
    parts = [f"<p>{html.escape(note)}</p>" for note in notes]
    for of_dataset in datasets:
        parts.append(f"<h2>{html.escape(f'{of_dataset.dataset}: {of_dataset.origin}')}</h2>")
        if of_dataset.dataset in costs:
            parts.append(_costs(costs[of_dataset.dataset]))
        for split, results in groupby(of_dataset.results, key=lambda result: result.split):
            parts += _section(list(results), split, of_dataset)
    body = "\n".join((*parts, "<h2>Rendering profiles</h2>", _profiles()))
    return (
        f'<!doctype html>\n<html lang="en"><head><meta charset="utf-8"><title>Tactophone benchmark</title>'
        f'<meta name="viewport" content="width=device-width"><style>{_STYLE}</style></head>\n'
        f"<body><h1>Tactophone benchmark</h1>\n{body}\n</body></html>\n"
    )


def row_of(result: MethodResult) -> tuple[str, ...]:
    """Return the cells of a result, in the order of :data:`COLUMNS`."""
    scores = result.scores["two-class"]
    difference = result.differences.get("balanced_accuracy")
    rendered = result.rendered
    return (
        result.method,
        str(rendered.balanced_accuracy),
        *(_number(share.value, ".3f") for share in (rendered.smooth_as_rough, rendered.wrong, rendered.gaps)),
        str(scores["balanced_accuracy"]),
        str(scores["auc"]),
        str(scores["recall_at_1"]),
        _number(scores["false_positive_rate"].value, ".3f"),
        _number(result.false_positives_at_reference, ".3f"),
        _number(result.bumps_per_minute, ".1f"),
        format_delay(result.contact_ms),
        format_delay(result.edge_ms),
        _number(result.calibration_error, ".3f"),
        _number(result.height_correlation, ".2f"),
        f"{_number(difference.p, '.3f')} ({_number(difference.corrected, '.3f')})" if difference else "-",
    )


def format_delay(delay: tuple[float, float, float]) -> str:
    """Format a delay in ms: p50 and p95 of all changes, and the share without a correct decision.

    >>> format_delay((95.0, float("inf"), 0.2))
    '95 / never (20 %)'
    >>> format_delay((82.4, 179.6, 0.04)), format_delay((float("nan"), float("nan"), float("nan")))
    ('82 / 180 (4 %)', '-')
    """
    p50, p95, missed = delay
    return "-" if math.isnan(p50) else f"{format_time(p50)} / {format_time(p95)} ({100 * missed:.0f} %)"


def format_time(time_ms: float) -> str:
    """Format a time in ms, or that it never comes."""
    return f"{time_ms:.0f}" if math.isfinite(time_ms) else "never"


def format_permuted(accuracies: Sequence[float]) -> str:
    """Format the scores on permuted labels.

    >>> format_permuted((0.52, 0.41))
    'balanced accuracy 0.52, 0.41'
    """
    return f"balanced accuracy {', '.join(f'{accuracy:.2f}' for accuracy in accuracies)}"


def format_seeds(scores: Sequence[tuple[float, float]]) -> str:
    """Format balanced accuracy and AUC over windows, seed by seed.

    >>> format_seeds(((0.82, 0.9), (0.79, 0.88)))
    '2 seeds: balanced accuracy 0.82, 0.79; AUC 0.90, 0.88'
    """
    accuracies, areas = (", ".join(f"{value:.2f}" for value in column) for column in zip(*scores, strict=True))
    return f"{len(scores)} seeds: balanced accuracy {accuracies}; AUC {areas}"


def format_heights(heights: Heights) -> str:
    """Say how well Ra is estimated."""
    return (
        f"Ra estimated from sound: off by {heights.error_decades:.2f} decades rms over {len(heights.surfaces)} "
        f"surfaces (a factor of {10**heights.error_decades:.1f}; single updates {heights.update_error_decades:.2f}; a "
        f"constant estimate {heights.spread_decades:.2f}); rank correlation {heights.correlation:.2f}"
    )


def steps_by_profile() -> dict[str, tuple[float, float]]:
    """Return the number of just-noticeable steps from smooth to rough, of frequency and in all, by profile."""
    return {name: discriminable_steps(open_profile(name)) for name in PROFILES}


def _section(results: Sequence[MethodResult], split: str, of_dataset: DatasetResults) -> list[str]:
    figures = [draw_scores(results), draw_curves(results)]
    if any(math.isfinite(result.contact_ms[0]) or math.isfinite(result.edge_ms[0]) for result in results):
        figures.append(draw_delays(results))
    figures += [draw_reliability(results), draw_surfaces(results)]
    lines = []
    if split in of_dataset.permuted:
        scores = format_permuted(of_dataset.permuted[split])
        lines.append(f"Control, texture trained on labels permuted over the surfaces: {scores}.")
    if split in of_dataset.seeds:
        lines.append(f"{results[0].method}, {format_seeds(of_dataset.seeds[split])}.")
    if split in of_dataset.heights:
        figures.append(draw_heights(of_dataset.heights[split]))
        lines.append(f"{format_heights(of_dataset.heights[split])}.")
    return [
        f"<h3>{html.escape(split)}</h3>",
        _table(
            COLUMNS,
            [(row_of(result), result) for result in results],
            caption="As rendered (gate, abstention, decision rule inside); windows in true contact, two-class rule.",
        ),
        *(f"<p>{html.escape(line)}</p>" for line in lines),
        _rules(results),
        '<div class="figures">',
        *(f'<div class="figure">{figure}</div>' for figure in figures),
        "</div>",
    ]


def _rules(results: Sequence[MethodResult]) -> str:
    names = ("balanced_accuracy", "smooth_accuracy", "rough_accuracy")
    rows = [
        (
            (result.method, *(str(result.scores[rule][name]) for rule in ("authors", "two-class") for name in names)),
            result,
        )
        for result in results
    ]
    columns = (f"{rule}: {name}" for rule in ("authors' rule", "two-class") for name in ("balanced", "smooth", "rough"))
    caption = "Accuracy by both rules; by the authors', a prediction none counts as smooth."
    return _table(("method", *columns), rows, caption=caption)


def _profiles() -> str:
    rows = [((name, f"{pitch:.1f}", f"{both:.1f}"), None) for name, (pitch, both) in steps_by_profile().items()]
    heading = ("profile", "steps of frequency", "steps with level")
    return _table(heading, rows, caption="Just-noticeable steps between smooth and rough (18 % of frequency, 1.5 dB).")


def _costs(costs: Mapping[str, Cost]) -> str:
    rows = [
        ((name, f"{cost.parameters:,}", f"{cost.byte_count / 1000:,.0f}", f"{cost.update_us:.0f}"), None)
        for name, cost in costs.items()
    ]
    heading = ("method", "parameters", "file (kB)", "processor time of an update (us)")
    return _table(heading, rows, caption="Cost of running each method, resampling and FFT included, in a hot loop.")


def _table(heading: Sequence[str], rows: Sequence[tuple[Sequence[str], MethodResult | None]], *, caption: str) -> str:
    head = "".join(f"<th>{html.escape(cell)}</th>" for cell in heading)
    lines = []
    for cells, result in rows:
        style = "control" if result and result.control else "texture" if cells[0] == "texture" else ""
        lines.append(f'<tr class="{style}">' + "".join(f"<td>{html.escape(cell)}</td>" for cell in cells) + "</tr>")
    return (
        f'<div class="scroll"><table><caption>{html.escape(caption)}</caption><thead><tr>{head}</tr></thead>'
        f"<tbody>{''.join(lines)}</tbody></table></div>"
    )


def _number(value: float, form: str) -> str:
    return "-" if math.isnan(value) else format(value, form)
