"""The figure of a run: sound, prediction, vibration and labels over time, as in the
paper's Figs. 7 and 8."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np

from tactophone.app.figures import (
    CONTACT_COLOUR,
    GREY,
    ORANGE,
    TOUCH_COLOURS,
    VIBRATION_COLOUR,
    as_shown,
    load_pyplot,
    save_figure,
)
from tactophone.app.vibration_wav import PeakEnvelope
from tactophone.core.recordings.values import Segment
from tactophone.core.types import Touch
from tactophone.live.telemetry.timeline import read_timeline

_WIDTH = 11.0
"""Width of the figure, in inches."""

_DPI = 130
"""Pixels of the figure in an inch."""

_NO_CONTACT_COLOUR = "#C9C9C9"


def draw_recording(
    path: Path,
    *,
    timeline: Path,
    microphones: PeakEnvelope,
    vibration: PeakEnvelope,
    title: str = "",
    truth: Sequence[Segment] = (),
    finger: str = "",
) -> None:
    """Draw a run, by its timeline (CSV) and the peak envelopes of its sound and
    vibration, and write it as PNG.

    Labelled segments (``truth``) are drawn as a strip. Of a hand, ``finger`` names
    whose lines of the timeline are drawn. Raises `TactophoneError` if matplotlib is not
    installed.
    """
    pyplot = load_pyplot()
    lines = read_timeline(timeline, finger=finger)
    _, low, _ = microphones.columns()
    channels = low.shape[1]
    heights = [1.0] * channels + [1.0, 1.0, 0.16] + ([0.16] if truth else [])
    figure, axes = pyplot.subplots(
        len(heights),
        1,
        sharex=True,
        layout="constrained",
        figsize=(_WIDTH, 1.25 + 1.1 * sum(heights)),
        height_ratios=heights,
    )
    _draw_microphones(axes[:channels], microphones)
    _draw_roughness(axes[channels], lines)
    _draw_vibration(axes[channels + 1], vibration, lines)
    _draw_strip(axes[channels + 2], "prediction", _spans(lines))
    if truth:
        _draw_strip(
            axes[-1],
            "label",
            [(segment.start, segment.end, segment.label) for segment in truth],
        )
    time, _, _ = vibration.columns()
    axes[-1].set(xlabel="time (s)", xlim=(0, float(time[-1]) if len(time) else 1.0))
    axes[0].set_title(as_shown(title), loc="left", fontsize=10)
    _add_legend(figure)
    save_figure(figure, path, dpi=_DPI)


def _draw_microphones(axes: Sequence[Any], envelope: PeakEnvelope) -> None:
    time, low, high = envelope.columns()
    names = ("contact", "air") if len(axes) == 2 else ("microphone",)
    for channel, (axis, name) in enumerate(zip(axes, names, strict=True)):
        axis.fill_between(
            time, low[:, channel], high[:, channel], color=CONTACT_COLOUR, linewidth=0.4
        )
        # Each on its own scale, at least -40 dBFS: the air microphone is some 20 dB
        # quieter than the contact one.
        reach = max(
            0.01, float(np.abs([low[:, channel], high[:, channel]]).max()) * 1.05
        )
        axis.set(ylim=(-reach, reach), ylabel=f"{name}\n(full scale)")


def _draw_roughness(axis: Any, lines: dict[str, Any]) -> None:
    in_contact = lines["contact"] > 0
    share = np.divide(
        lines["rough"],
        lines["smooth"] + lines["rough"],
        out=np.full_like(lines["rough"], np.nan),
        where=lines["smooth"] + lines["rough"] > 0,
    )
    axis.step(
        lines["time"],
        np.where(in_contact, share, np.nan),
        where="post",
        color=TOUCH_COLOURS[Touch.ROUGH],
        linewidth=1.1,
        label="roughness in contact",
    )
    axis.step(
        lines["time"],
        share,
        where="post",
        color=_NO_CONTACT_COLOUR,
        linewidth=0.7,
        zorder=1,
        label="... without contact",
    )
    if (unknown := lines["unknown"] > 0).any():
        axis.fill_between(
            lines["time"],
            0,
            1,
            where=unknown,
            step="post",
            facecolor="none",
            edgecolor=GREY,
            hatch="///",
            linewidth=0,
            label="unknown",
        )
    axis.axhline(0.5, color=GREY, linewidth=0.6, linestyle=(0, (4, 4)))
    axis.set(ylim=(-0.04, 1.04), yticks=(0, 0.5, 1), ylabel="P(rough | contact)")


def _draw_vibration(axis: Any, envelope: PeakEnvelope, lines: dict[str, Any]) -> None:
    time, low, high = envelope.columns()
    axis.fill_between(
        time, low[:, 0], high[:, 0], color=VIBRATION_COLOUR, linewidth=0.4
    )
    axis.set(ylim=(-1.05, 1.05), yticks=(-1, 0, 1), ylabel="vibration\n(full drive)")
    pitch = axis.twinx()
    frequency = np.where(lines["amplitude"] > 0, lines["frequency"], np.nan)
    pitch.step(
        lines["time"],
        frequency,
        where="post",
        color=ORANGE,
        linewidth=1.2,
        label="vibration frequency",
    )
    pitch.set(ylim=(0, None if np.nanmax(frequency, initial=0) > 140 else 150))
    pitch.set_ylabel("frequency (Hz)", color="#A06E00")
    pitch.spines["right"].set_visible(True)


def _draw_strip(
    axis: Any, name: str, spans: Sequence[tuple[float, float, Touch | None]]
) -> None:
    for start, end, touch in spans:
        if touch is not None and np.isfinite(end):
            axis.axvspan(
                start,
                end,
                color=TOUCH_COLOURS[touch],
                alpha=0.25 if touch is Touch.NONE else 1,
                linewidth=0,
            )
    axis.set(yticks=[], ylim=(0, 1))
    axis.set_ylabel(name, rotation=0, ha="right", va="center")
    for side in ("left", "bottom"):
        axis.spines[side].set_visible(False)
    axis.tick_params(bottom=False)


def _spans(lines: dict[str, Any]) -> list[tuple[float, float, Touch]]:
    """Join consecutive lines of equal touch to spans of start, end and touch."""
    time = lines["time"]
    touch = lines["touch"]
    if not len(time):
        return []
    edges = np.flatnonzero(np.diff(touch)) + 1
    starts = np.concatenate(([0], edges))
    ends = np.concatenate((time[edges], time[-1:]))
    return [
        (float(time[at]), float(end), Touch(int(touch[at])))
        for at, end in zip(starts, ends, strict=True)
    ]


def _add_legend(figure: Any) -> None:
    from matplotlib.patches import Patch

    strips = [
        Patch(
            color=colour,
            alpha=0.25 if touch is Touch.NONE else 1,
            label=touch.name.lower(),
        )
        for touch, colour in TOUCH_COLOURS.items()
    ]
    handles = [
        *strips,
        *(
            handle
            for axis in figure.axes
            for handle in axis.get_legend_handles_labels()[0]
        ),
    ]
    legend = figure.legend(
        handles=handles,
        loc="outside lower center",
        ncols=len(handles),
        frameon=False,
        fontsize=8,
    )
    for line in legend.get_lines():
        line.set_linewidth(1.5)
