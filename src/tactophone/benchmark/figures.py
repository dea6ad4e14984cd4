"""The benchmark's figures, as SVG text that stands inside a page."""

import io
from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any

import numpy as np

from tactophone.benchmark.height_regression import Heights
from tactophone.benchmark.result import Result
from tactophone.offline.plots import BLUE, GREEN, GREY, ORANGE, PURPLE, VERMILION, load_pyplot

_STYLES: Mapping[str, tuple[str, str]] = MappingProxyType(
    {
        "paper/general": (BLUE, "-"), "paper/fine-tuned": (BLUE, "--"), "paper/one-channel": (BLUE, ":"),
        "level": (GREY, "-"), "rules": (GREY, "--"), "median-frequency": (GREY, ":"),
        "scalogram-cnn": (PURPLE, "-"),
        "surface": (ORANGE, ":"), "impulses": (ORANGE, "-."), "logistic": (ORANGE, "-"), "boosting": (ORANGE, "--"),
        "direct": (GREEN, "-"), "pitch": (GREEN, "--"),
        "ours": (VERMILION, "-"), "ours/air-dead": (VERMILION, "--"),
    }
)  # fmt: skip
"""A colour for each family of methods and a dash for each member, the same in every figure."""

MOST_CELLS = 20
"""Surfaces in a picture whose cells still hold a number that can be read."""

_CONTROL_STYLE = ("black", ":")
_BOLD = ("ours", "paper/general")


def draw_scores(results: Sequence[Result]) -> str:
    """Draw balanced accuracy of every method with its interval, best on top."""
    pyplot = load_pyplot()
    rows = sorted(results, key=lambda one: one.scores["two-class"]["balanced_accuracy"].value)
    figure, axis = pyplot.subplots(figsize=(7.2, 0.9 + 0.3 * len(rows)), layout="constrained")
    for place, one in enumerate(rows):
        score = one.scores["two-class"]["balanced_accuracy"]
        colour, _ = style_of(one)
        axis.plot([score.low, score.high], [place, place], color=colour, linewidth=2.2, alpha=0.55)
        axis.plot(score.value, place, "o", color=colour, markersize=6, markerfacecolor="white" if one.control else None)
    axis.axvline(0.5, color=GREY, linewidth=0.8, linestyle=(0, (4, 4)))
    axis.text(0.502, len(rows) - 0.4, "chance", color="#555555", fontsize=8)
    axis.set(yticks=range(len(rows)), yticklabels=[one.method for one in rows], ylim=(-0.6, len(rows) - 0.1))
    axis.set_xlabel("balanced accuracy per update (90 % of draws of the surfaces)")
    return _svg(pyplot, figure)


def draw_curves(results: Sequence[Result]) -> str:
    """Draw rough recall over the false positive rate, on a log axis: what matters is on the left."""
    pyplot = load_pyplot()
    figure, axis = pyplot.subplots(figsize=(7.2, 4.2), layout="constrained")
    for one in results:
        rate, recall = np.array(one.curve).T
        axis.plot(100 * rate, recall, label=one.method, **_line(one))
    axis.axvline(1.0, color=GREY, linewidth=0.8, linestyle=(0, (4, 4)))
    axis.set(xscale="log", xlim=(0.1, 100), ylim=(0, 1), xticks=(0.1, 1, 10, 100), ylabel="rough updates found")
    axis.set_xticklabels(("0.1", "1", "10", "100"))
    axis.set_xlabel("smooth updates called rough (%)")
    axis.legend(frameon=False, fontsize=8, loc="center left", bbox_to_anchor=(1.0, 0.5))
    return _svg(pyplot, figure)


def draw_delays(results: Sequence[Result]) -> str:
    """Draw the time to a right decision after contact and after an edge: median to 95th percentile."""
    pyplot = load_pyplot()
    kinds = {
        "after contact": {one.method: one.contact_ms for one in results},
        "after an edge": {one.method: one.edge_ms for one in results},
    }
    kinds = {name: some for name, some in kinds.items() if any(np.isfinite(middle) for middle, _, _ in some.values())}
    colours = {one.method: style_of(one)[0] for one in results}
    rows = [one.method for one in results if any(np.isfinite(some[one.method][0]) for some in kinds.values())][::-1]
    figure, axes = pyplot.subplots(
        1, len(kinds), sharey=True, squeeze=False, figsize=(3.6 * len(kinds) + 1, 0.9 + 0.27 * len(rows)),
        layout="constrained",
    )  # fmt: skip
    axes = axes[0]
    for axis, (name, times) in zip(axes, kinds.items(), strict=True):
        for place, method in enumerate(rows):
            _draw_delay(axis, place, times[method], colour=colours[method])
        axis.axvline(100, color=GREY, linewidth=0.7, linestyle=(0, (4, 4)))
        axis.set(xlabel=f"ms to a right decision\n{name}: median, 95 %", xlim=(0, None))
        axis.margins(x=0.25)
    axes[0].set(yticks=range(len(rows)), yticklabels=rows, ylim=(-0.6, len(rows) - 0.4))
    return _svg(pyplot, figure)


def _draw_delay(axis: Any, place: int, delay: tuple[float, float, float], *, colour: str) -> None:
    middle, late, missed = delay
    if not np.isfinite(middle):
        return
    axis.plot([middle, late], [place, place], color=colour, linewidth=2.2, alpha=0.55)
    axis.plot(middle, place, "o", color=colour, markersize=5)
    axis.plot(late, place, "|", color=colour, markersize=9)
    axis.annotate(
        f"never: {missed:.0%}", (late, place), xytext=(6, 0), textcoords="offset points", fontsize=7, va="center",
        color="#555555",
    )  # fmt: skip


def draw_reliability(results: Sequence[Result]) -> str:
    """Draw how often rough is true over how sure of it a method is; honest ones follow the diagonal."""
    pyplot = load_pyplot()
    kept = [one for one in results if not one.control and one.reliability]
    figure, axis = pyplot.subplots(figsize=(6.4, 4.2), layout="constrained")
    axis.plot([0, 1], [0, 1], color=GREY, linewidth=0.8, linestyle=(0, (4, 4)))
    for one in kept:
        confidence, share = np.array(one.reliability).T
        axis.plot(confidence, share, marker="o", markersize=3, label=one.method, **_line(one))
    axis.set(xlim=(0, 1), ylim=(0, 1), xlabel="confidence in rough", ylabel="share truly rough")
    axis.legend(frameon=False, fontsize=8, loc="center left", bbox_to_anchor=(1.0, 0.5))
    return _svg(pyplot, figure)


def draw_surfaces(results: Sequence[Result]) -> str:
    """Draw which surfaces each method tells, and which it does not: the share of updates called rightly."""
    pyplot = load_pyplot()
    names = sorted(results[0].by_surface, key=lambda name: (results[0].by_surface[name], name))
    shares = np.array([[100 * one.by_surface.get(name, np.nan) for name in names] for one in results])
    figure, axis = pyplot.subplots(figsize=(7.2, 1.6 + 0.24 * len(results)), layout="constrained")
    image = axis.imshow(shares, cmap="cividis", vmin=0, vmax=100, aspect="auto")
    for row, column in np.ndindex(shares.shape) if len(names) <= MOST_CELLS else ():
        ink = "white" if shares[row, column] < 60 else "black"
        axis.text(column, row, f"{shares[row, column]:.0f}", ha="center", va="center", fontsize=6, color=ink)
    axis.set_xticks(range(len(names)), names, rotation=60, ha="right", rotation_mode="anchor", fontsize=7)
    axis.set_yticks(range(len(results)), [one.method for one in results], fontsize=7)
    axis.tick_params(length=0)
    figure.colorbar(image, label="updates called rightly (%)", pad=0.01)
    return _svg(pyplot, figure)


def draw_heights(heights: Heights) -> str:
    """Draw each surface's true Ra and the one told from its sound, smoothest at the bottom."""
    pyplot = load_pyplot()
    rows = sorted(heights.surfaces, key=lambda row: row[1])
    figure, axis = pyplot.subplots(figsize=(7.2, 0.9 + 0.2 * len(rows)), layout="constrained")
    names, true, told = zip(*rows, strict=True)
    axis.hlines(range(len(rows)), true, told, color=GREY, linewidth=1)
    axis.plot(true, range(len(rows)), "o", color="black", markerfacecolor="white", markersize=5, label="true")
    axis.plot(told, range(len(rows)), "o", color=ORANGE, markersize=5, label="told from sound, never heard before")
    axis.set(xscale="log", xlabel="Ra (\u00b5m)", ylim=(-0.6, len(rows) - 0.4))
    axis.set_yticks(range(len(rows)), names, fontsize=7)
    axis.legend(frameon=False, fontsize=8, loc="lower right")
    return _svg(pyplot, figure)


def style_of(result: Result) -> tuple[str, str]:
    """Give a method's colour and dash: ours vermilion and the paper blue, everywhere."""
    return _CONTROL_STYLE if result.control else _STYLES.get(result.method, (GREY, "-."))


def _line(result: Result) -> dict[str, Any]:
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
