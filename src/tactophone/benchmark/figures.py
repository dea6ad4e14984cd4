"""The benchmark's figures, as SVG text to embed in HTML."""

import io
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any

import numpy as np

from tactophone.benchmark.height_regression import Heights
from tactophone.benchmark.result import MethodResult
from tactophone.evaluation.events import HALF
from tactophone.plotting import BLUE, GREEN, GREY, ORANGE, PURPLE, VERMILION, load_pyplot

_STYLES: Mapping[str, tuple[str, str]] = MappingProxyType(
    {
        "paper/general": (BLUE, "-"), "paper/fine-tuned": (BLUE, "--"), "paper/one-channel": (BLUE, ":"),
        "level": (GREY, "-"), "rules": (GREY, "--"), "median-frequency": (GREY, ":"),
        "scalogram-cnn": (PURPLE, "-"),
        "surface": (ORANGE, ":"), "logistic": (ORANGE, "-"), "boosting": (ORANGE, "--"),
        "direct": (GREEN, "-"), "pitch": (GREEN, "--"),
        "texture": (VERMILION, "-"), "texture/no-air": (VERMILION, "--"),
    }
)  # fmt: skip
"""A colour for each family of methods and a dash for each member, the same in every figure."""

MOST_CELLS = 20
"""Surfaces in a figure whose cells still hold a legible number."""

_CONTROL_STYLE = ("black", ":")
_BOLD = ("texture", "paper/general")


def draw_scores(results: Sequence[MethodResult]) -> str:
    """Draw balanced accuracy of every method with its interval, best on top."""
    pyplot = load_pyplot()
    rows = sorted(results, key=lambda result: result.scores["two-class"]["balanced_accuracy"].value)
    figure, axis = pyplot.subplots(figsize=(7.2, 0.9 + 0.3 * len(rows)), layout="constrained")
    for place, result in enumerate(rows):
        score = result.scores["two-class"]["balanced_accuracy"]
        colour, _ = style_of(result)
        face = "white" if result.control else None
        axis.plot([score.low, score.high], [place, place], color=colour, linewidth=2.2, alpha=0.55)
        axis.plot(score.value, place, "o", color=colour, markersize=6, markerfacecolor=face)
    axis.axvline(0.5, color=GREY, linewidth=0.8, linestyle=(0, (4, 4)))
    axis.text(0.502, len(rows) - 0.4, "chance", color="#555555", fontsize=8)
    axis.set(yticks=range(len(rows)), yticklabels=[result.method for result in rows], ylim=(-0.6, len(rows) - 0.1))
    axis.set_xlabel("balanced accuracy per update (90 % interval over surfaces)")
    return _svg(pyplot, figure)


def draw_curves(results: Sequence[MethodResult]) -> str:
    """Draw the ROC curves on a log axis, because low false positive rates matter."""
    pyplot = load_pyplot()
    figure, axis = pyplot.subplots(figsize=(7.2, 4.2), layout="constrained")
    for result in results:
        rate, recall = np.array(result.curve).T
        axis.plot(100 * rate, recall, label=result.method, **_line(result))
    axis.axvline(1.0, color=GREY, linewidth=0.8, linestyle=(0, (4, 4)))
    axis.set(xscale="log", xlim=(0.1, 100), ylim=(0, 1), xticks=(0.1, 1, 10, 100), ylabel="rough updates found")
    axis.set_xticklabels(("0.1", "1", "10", "100"))
    axis.set_xlabel("smooth updates classified as rough (%)")
    axis.legend(frameon=False, fontsize=8, loc="center left", bbox_to_anchor=(1.0, 0.5))
    return _svg(pyplot, figure)


def draw_delays(results: Sequence[MethodResult]) -> str:
    """Draw the time to a correct decision after contact and after an edge: p50 to p95."""
    pyplot = load_pyplot()
    kinds = {
        "after contact": {result.method: result.contact_ms for result in results},
        "after an edge": {result.method: result.edge_ms for result in results},
    }
    kinds = {name: delays for name, delays in kinds.items() if any(np.isfinite(p50) for p50, _, _ in delays.values())}
    colours = {result.method: style_of(result)[0] for result in results}
    known = [name for name in colours if any(np.isfinite(delays[name][0]) for delays in kinds.values())]
    rows = known[::-1]
    figure, axes = pyplot.subplots(
        1, len(kinds), sharey=True, squeeze=False, figsize=(3.6 * len(kinds) + 1, 0.9 + 0.27 * len(rows)),
        layout="constrained",
    )  # fmt: skip
    axes = axes[0]
    for axis, (name, times) in zip(axes, kinds.items(), strict=True):
        for place, method in enumerate(rows):
            _draw_delay(axis, place, times[method], colour=colours[method])
        axis.axvline(100, color=GREY, linewidth=0.7, linestyle=(0, (4, 4)))
        axis.set(xlabel=f"ms to a correct decision\n{name}: p50, p95", xlim=(0, None))
        axis.margins(x=0.25)
    axes[0].set(yticks=range(len(rows)), yticklabels=rows, ylim=(-0.6, len(rows) - 0.4))
    return _svg(pyplot, figure)


def _draw_delay(axis: Any, place: int, delay: tuple[float, float, float], *, colour: str) -> None:
    p50, p95, missed = delay
    if not np.isfinite(p50):
        return
    # A p95 that never comes reaches as far as joined edges do, with an arrow.
    end, marker = (p95, "|") if np.isfinite(p95) else (1e3 * HALF, ">")
    axis.plot([p50, end], [place, place], color=colour, linewidth=2.2, alpha=0.55)
    axis.plot(p50, place, "o", color=colour, markersize=5)
    axis.plot(end, place, marker, color=colour, markersize=9 if marker == "|" else 4)
    axis.annotate(
        f"never: {missed:.0%}", (end, place), xytext=(6, 0), textcoords="offset points", fontsize=7, va="center",
        color="#555555",
    )  # fmt: skip


def draw_reliability(results: Sequence[MethodResult]) -> str:
    """Draw the share truly rough over P(rough); calibrated methods follow the diagonal."""
    pyplot = load_pyplot()
    kept = [result for result in results if not result.control and result.reliability]
    figure, axis = pyplot.subplots(figsize=(6.4, 4.2), layout="constrained")
    axis.plot([0, 1], [0, 1], color=GREY, linewidth=0.8, linestyle=(0, (4, 4)))
    for result in kept:
        confidence, share = np.array(result.reliability).T
        axis.plot(confidence, share, marker="o", markersize=3, label=result.method, **_line(result))
    axis.set(xlim=(0, 1), ylim=(0, 1), xlabel="P(rough)", ylabel="share truly rough")
    axis.legend(frameon=False, fontsize=8, loc="center left", bbox_to_anchor=(1.0, 0.5))
    return _svg(pyplot, figure)


def draw_surfaces(results: Sequence[MethodResult]) -> str:
    """Draw the share of updates classified correctly, by method and surface."""
    pyplot = load_pyplot()
    names = sorted(results[0].by_surface, key=lambda name: (results[0].by_surface[name], name))
    shares = np.array([[100 * result.by_surface.get(name, np.nan) for name in names] for result in results])
    figure, axis = pyplot.subplots(figsize=(7.2, 1.6 + 0.24 * len(results)), layout="constrained")
    image = axis.imshow(shares, cmap="cividis", vmin=0, vmax=100, aspect="auto")
    for row, column in np.ndindex(shares.shape) if len(names) <= MOST_CELLS else ():
        ink = "white" if shares[row, column] < 60 else "black"
        axis.text(column, row, f"{shares[row, column]:.0f}", ha="center", va="center", fontsize=6, color=ink)
    axis.set_xticks(range(len(names)), names, rotation=60, ha="right", rotation_mode="anchor", fontsize=7)
    axis.set_yticks(range(len(results)), [result.method for result in results], fontsize=7)
    axis.tick_params(length=0)
    figure.colorbar(image, label="updates classified correctly (%)", pad=0.01)
    return _svg(pyplot, figure)


def draw_heights(heights: Heights) -> str:
    """Draw each surface's true Ra and its estimate from sound, smoothest at the bottom."""
    pyplot = load_pyplot()
    rows = sorted(heights.surfaces, key=lambda row: row[1])
    figure, axis = pyplot.subplots(figsize=(7.2, 0.9 + 0.2 * len(rows)), layout="constrained")
    names, true, estimated = zip(*rows, strict=True)
    axis.hlines(range(len(rows)), true, estimated, color=GREY, linewidth=1)
    axis.plot(true, range(len(rows)), "o", color="black", markerfacecolor="white", markersize=5, label="true")
    axis.plot(estimated, range(len(rows)), "o", color=ORANGE, markersize=5, label="estimated from sound, held out")
    axis.set(xscale="log", xlabel="Ra (\u00b5m)", ylim=(-0.6, len(rows) - 0.4))
    axis.set_yticks(range(len(rows)), names, fontsize=7)
    axis.legend(frameon=False, fontsize=8, loc="lower right")
    return _svg(pyplot, figure)


def style_of(result: MethodResult) -> tuple[str, str]:
    """Return a method's colour and dash: texture vermilion and the paper blue, everywhere."""
    return _CONTROL_STYLE if result.control else _STYLES.get(result.method, (GREY, "-."))


def _line(result: MethodResult) -> dict[str, Any]:
    colour, dash = style_of(result)
    bold = result.method in _BOLD
    width, alpha, order = (2.4, 1.0, 3) if bold else (1.1, 0.75, 2)
    return {"color": colour, "linestyle": dash, "linewidth": width, "alpha": alpha, "zorder": order}


def _svg(pyplot: Any, figure: Any) -> str:
    out = io.StringIO()
    with pyplot.rc_context({"svg.hashsalt": "tactophone", "svg.fonttype": "none"}):
        figure.savefig(out, format="svg", metadata={"Date": None})
    pyplot.close(figure)
    return out.getvalue().partition("<svg")[1] + out.getvalue().partition("<svg")[2]
