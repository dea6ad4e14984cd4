"""The benchmark's report: one HTML file that holds its tables and figures, and loads nothing."""

import html
import math
from collections.abc import Iterable, Mapping, Sequence
from itertools import groupby

from tactophone.benchmark.entries import Cost
from tactophone.benchmark.figures import (
    draw_curves,
    draw_delays,
    draw_heights,
    draw_reliability,
    draw_scores,
    draw_surfaces,
)
from tactophone.benchmark.goals import goals_of, tell
from tactophone.benchmark.height_regression import Heights
from tactophone.benchmark.plan import Findings
from tactophone.benchmark.result import Result
from tactophone.haptics import PROFILES, discriminable_steps, open_profile

COLUMNS = (
    "method", "balanced accuracy", "AUC", "recall at 1 %", "false positives", "at the reference's recall",
    "false bumps a minute", "contact, ms: p50 / p95 (never)", "edge, ms: p50 / p95 (never)", "calibration error",
    "rank with Ra", "p",
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
tr.ours { background: var(--best); } tr.control { font-style: italic; opacity: .75; }
.figures { display: flex; flex-wrap: wrap; gap: 1rem; align-items: flex-start; }
.figure { padding: .5rem; flex: 1 1 34rem; max-width: 46rem; } .figure svg { width: 100%; height: auto; }
"""


def write_page(findings: Sequence[Findings], *, costs: Mapping[str, Mapping[str, Cost]], notes: Iterable[str]) -> str:
    """Write the report.

    Parameters
    ----------
    findings
        A data set each.
    costs
        Of each method, by data set.
    notes
        Paragraphs at the top: what was run, on what.
    """
    parts = [f"<p>{html.escape(note)}</p>" for note in notes]
    for one in findings:
        parts.append(f"<h2>{html.escape(f'{one.dataset}: {one.origin}')}</h2>")
        if one.dataset in costs:
            parts.append(_costs(costs[one.dataset]))
        for split, some in groupby(one.results, key=lambda result: result.split):
            parts += _section(list(some), split, one, costs.get(one.dataset, {}))
    body = "\n".join((*parts, "<h2>Rendering profiles</h2>", _profiles()))
    return (
        f'<!doctype html>\n<html lang="en"><head><meta charset="utf-8"><title>Tactophone benchmark</title>'
        f'<meta name="viewport" content="width=device-width"><style>{_STYLE}</style></head>\n'
        f"<body><h1>Tactophone benchmark</h1>\n{body}\n</body></html>\n"
    )


def row_of(result: Result) -> tuple[str, ...]:
    """Tell a result in the order of :data:`COLUMNS`."""
    scores = result.scores["two-class"]
    difference = result.differences.get("balanced_accuracy")
    return (
        result.method,
        str(scores["balanced_accuracy"]),
        str(scores["auc"]),
        str(scores["recall_at_1"]),
        _number(scores["false_positive_rate"].value, ".3f"),
        _number(result.false_positives_at_reference, ".3f"),
        _number(result.bumps_per_minute, ".1f"),
        told_delay(result.contact_ms),
        told_delay(result.edge_ms),
        _number(result.calibration_error, ".3f"),
        _number(result.height_correlation, ".2f"),
        _number(difference.p, ".3f") if difference else "-",
    )


def told_delay(delay: tuple[float, float, float]) -> str:
    """Tell a delay in ms: median, 95th percentile, and how many never came.

    >>> told_delay((82.4, 179.6, 0.04)), told_delay((float("nan"), float("nan"), float("nan")))
    ('82 / 180 (4 %)', '-')
    """
    middle, late, missed = delay
    return "-" if math.isnan(middle) else f"{middle:.0f} / {late:.0f} ({100 * missed:.0f} %)"


def told_dealt(dealt: Sequence[float]) -> str:
    """Tell what is learnt where there is nothing to learn.

    >>> told_dealt((0.52, 0.41))
    'balanced accuracy 0.52, 0.41'
    """
    return f"balanced accuracy {', '.join(f'{one:.2f}' for one in dealt)}"


def told_heights(heights: Heights) -> str:
    """Tell how well Ra is regressed."""
    return (
        f"Ra told from sound: off by {heights.error_decades:.2f} decades rms over {len(heights.surfaces)} surfaces "
        f"(a factor of {10**heights.error_decades:.1f}; single updates {heights.update_error_decades:.2f}; saying the "
        f"same of all {heights.spread_decades:.2f}); rank correlation {heights.correlation:.2f}"
    )


def steps_by_profile() -> dict[str, tuple[float, float]]:
    """Count the steps that a finger tells apart from smooth to rough, of frequency and in all, profile by profile."""
    return {name: discriminable_steps(open_profile(name)) for name in PROFILES}


def _section(results: Sequence[Result], split: str, found: Findings, costs: Mapping[str, Cost]) -> list[str]:
    figures = [draw_scores(results), draw_curves(results)]
    if any(math.isfinite(one.contact_ms[0]) or math.isfinite(one.edge_ms[0]) for one in results):
        figures.append(draw_delays(results))
    figures += [draw_reliability(results), draw_surfaces(results)]
    lines = []
    if split in found.dealt:
        told = told_dealt(found.dealt[split])
        lines.append(f"Control, labels dealt anew over the surfaces and learnt by ours: {told}.")
    if split in found.heights:
        figures.append(draw_heights(found.heights[split]))
        lines.append(f"{told_heights(found.heights[split])}.")
    return [
        f"<h3>{html.escape(split)}</h3>",
        _table(COLUMNS, [(row_of(one), one) for one in results], caption="Updates in contact, two-class rule."),
        *(f"<p>{html.escape(line)}</p>" for line in lines),
        _rules(results),
        _goals(results, costs),
        '<div class="figures">',
        *(f'<div class="figure">{figure}</div>' for figure in figures),
        "</div>",
    ]


def _rules(results: Sequence[Result]) -> str:
    names = ("balanced_accuracy", "smooth_accuracy", "rough_accuracy")
    rows = [
        (
            (one.method, *(str(one.scores[rule][name]) for rule in ("authors", "two-class") for name in names)),
            one,
        )
        for one in results
    ]
    told = (f"{rule}: {name}" for rule in ("authors' rule", "two-class") for name in ("balanced", "smooth", "rough"))
    caption = "Accuracy by both rules; by the authors', an answer none counts as smooth."
    return _table(("method", *told), rows, caption=caption)


def _goals(results: Sequence[Result], costs: Mapping[str, Cost]) -> str:
    rows = [
        ((one.told, tell(one.reference), tell(one.ours), tell(one.limit), one.verdict), None)
        for one in goals_of(results, costs)
    ]
    heading = ("what ours set out to reach", results[0].method, "ours", "goal, at most", "")
    return _table(heading, rows, caption="Ours beside the paper's network, in this run.") if rows else ""


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
    return _table(heading, rows, caption="What each costs to run, resampling and FFT included, in a hot loop.")


def _table(heading: Sequence[str], rows: Sequence[tuple[Sequence[str], Result | None]], *, caption: str) -> str:
    head = "".join(f"<th>{html.escape(cell)}</th>" for cell in heading)
    lines = []
    for cells, result in rows:
        kind = "control" if result and result.control else "ours" if cells[0] == "ours" else ""
        lines.append(f'<tr class="{kind}">' + "".join(f"<td>{html.escape(cell)}</td>" for cell in cells) + "</tr>")
    return (
        f'<div class="scroll"><table><caption>{html.escape(caption)}</caption><thead><tr>{head}</tr></thead>'
        f"<tbody>{''.join(lines)}</tbody></table></div>"
    )


def _number(value: float, form: str) -> str:
    return "-" if math.isnan(value) else format(value, form)
