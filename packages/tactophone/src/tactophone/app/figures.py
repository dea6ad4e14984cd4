"""What all figures share, matplotlib and one set of colours; and a data set as a
figure.

The colours come from Okabe and Ito (2008); they stay distinct for every kind of
colour vision.
"""

import re
from collections import Counter
from collections.abc import Sequence
from importlib.resources import files
from pathlib import Path
from typing import Any

import numpy as np

from tactophone.core.errors import TactophoneError, plain
from tactophone.core.foreign_settings import refuse_settings_here
from tactophone.core.processes import atomic_write
from tactophone.core.recordings.values import Dataset, Recording
from tactophone.core.types import SURFACE_LABELS, Touch

# Okabe and Ito's colours, which people with any colour vision tell apart.
BLUE = "#0072B2"
ORANGE = "#E69F00"
GREEN = "#009E73"
VERMILION = "#D55E00"

_PALETTE = (files("tactophone.core") / "palette.css").read_text(encoding="utf-8")


def _colour(name: str) -> str:
    """Return a colour of the pages' light theme, whose file serves figures too."""
    found: str = re.findall(rf"--{name}: (#\w+)", _PALETTE)[0]
    return found


TOUCH_COLOURS = {touch: _colour(touch.name.lower()) for touch in Touch}
CONTACT_COLOUR = _colour("contact")
VIBRATION_COLOUR = _colour("vibration")
GREY = "#8C8C8C"
"""For what is absent; not one of Okabe and Ito's."""

_STYLE: Any = {
    "font.size": 9,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.labelcolor": "#333333",
    "axes.edgecolor": "#999999",
    "xtick.color": "#555555",
    "ytick.color": "#555555",
}

PANELS = 12
"""Most spectrograms in the figure of a data set."""

EXCERPT = 5.0
"""Seconds of a recording that a small panel can show."""

MAX_FREQUENCY = 4000.0
"""Hz; what the link's usual setting transmits."""


def load_pyplot() -> Any:
    """Import matplotlib's pyplot with the project's style, for files only (no window).

    Raises `TactophoneError` if matplotlib is not installed, or the current folder holds
    settings for it.
    """
    refuse_settings_here("matplotlib")
    try:
        import matplotlib as mpl  # slow to import, and only figures need it
    except ImportError as error:
        raise TactophoneError(
            "figures need matplotlib: pip install 'tactophone[plot]'"
        ) from error
    mpl.use("Agg")
    from matplotlib import pyplot

    pyplot.rcParams.update(_STYLE)
    return pyplot


def as_shown(name: str) -> str:
    """Return a name from a file as a figure's text; to matplotlib, what stands between
    two dollar signs is a formula.

    >>> as_shown("5$ or 10$")
    '5\\\\$ or 10\\\\$'
    """
    return plain(name).replace("$", r"\$")


def save_figure(figure: Any, path: Path, **options: Any) -> None:
    """Write a figure to ``path``, replacing any file there, and close it.

    ``options`` are passed to ``savefig``.
    """
    # By another name first: a full disk would leave an empty file.
    suffix = path.suffix.removeprefix(".")
    with atomic_write(path) as unfinished:
        figure.savefig(unfinished, **({"format": suffix} | options))
    load_pyplot().close(figure)


def draw_dataset(path: Path, dataset: Dataset) -> None:
    """Draw the level of each take, and spectrograms of up to 12 recordings spread
    evenly over the set, as PNG.

    Raises `TactophoneError` if matplotlib is not installed.
    """
    pyplot = load_pyplot()
    readable = [
        recording
        for recording in dataset.recordings
        if recording.path.is_file() and recording.path.stat().st_size
    ]
    places = np.unique(
        np.linspace(0, len(readable) - 1, min(PANELS, len(readable))).astype(int)
    )
    shown = [readable[place] for place in places]
    rows = -(-len(shown) // 4)
    height = 0.28 * len(dataset.surfaces) + 1.2
    figure = pyplot.figure(
        figsize=(11, height + 2.2 * rows), layout="constrained", dpi=90
    )
    upper, lower = figure.subfigures(2, 1, height_ratios=[height, 2.2 * rows])
    _draw_levels(upper.subplots(), dataset, readable)
    axes = np.atleast_1d(
        lower.subplots(rows, min(4, len(shown)), sharey=True, squeeze=False)
    ).ravel()
    image = None
    for panel, recording in zip(axes, shown, strict=False):
        image = _draw_spectrogram(panel, recording)
    for panel in axes[len(shown) :]:
        panel.set_axis_off()
    lower.supylabel("contact (or only) channel, kHz", fontsize=9)
    if image is not None:
        lower.colorbar(image, ax=axes, label="dBFS/Hz", pad=0.01)
    save_figure(figure, path)


def _draw_levels(axes: Any, dataset: Dataset, recordings: Sequence[Recording]) -> None:
    row_of = {surface: row for row, surface in enumerate(reversed(dataset.surfaces))}
    drawn: Counter[str] = Counter()
    max_takes = max(
        Counter(recording.surface for recording in recordings).values(), default=1
    )
    for recording in recordings:
        surface = recording.surface
        low, middle, high = _levels(recording)
        colour = GREY if recording.label is None else TOUCH_COLOURS[recording.label]
        # Takes of a surface share its row, spread over 0.7 of the row's height.
        height = row_of[surface] + 0.7 * ((drawn[surface] + 0.5) / max_takes - 0.5)
        drawn[surface] += 1
        axes.plot([low, high], [height] * 2, color=colour, alpha=0.35, linewidth=1.5)
        axes.plot(middle, height, "o", color=colour, markersize=3)
    axes.set_yticks(range(len(row_of)), [*map(as_shown, row_of)], fontsize=9)
    axes.set_xlabel(
        "level of 0.25 s in dBFS: p50 and p10 to p90 of each take", fontsize=9
    )
    for label in reversed(SURFACE_LABELS):
        axes.plot([], [], "o", color=TOUCH_COLOURS[label], label=label.name.lower())
    axes.legend(frameon=False, fontsize=8, loc="upper left", bbox_to_anchor=(1, 1))
    axes.grid(axis="x", alpha=0.3)


def _levels(recording: Recording) -> tuple[float, float, float]:
    """Return p10, p50 and p90 of the level over 0.25 s, in dBFS, of the first
    channel."""
    sound = recording.read()
    size = max(1, sound.sample_rate // 4)
    cells = sound.samples[: sound.size // size * size, 0].reshape(-1, size)
    power = np.square(cells, dtype=np.float64).mean(axis=1)
    levels = (
        10 * np.log10(np.maximum(power, 1e-10)) if len(power) else np.array([-100.0])
    )
    low, middle, high = np.percentile(levels, [10, 50, 90])
    return float(low), float(middle), float(high)


def _draw_spectrogram(axes: Any, recording: Recording) -> Any:
    """Draw it, and return its image, for the bar that says what its colours mean."""
    sound = recording.read(duration=EXCERPT)
    rate = sound.sample_rate
    size = 1 << int(np.log2(rate / 40))
    *_, image = axes.specgram(
        sound.samples[:, 0] + 1e-9,
        NFFT=size,
        Fs=rate,
        noverlap=size // 2,
        cmap="magma",
        vmin=-120,
        vmax=-40,
    )
    axes.set_ylim(0, min(MAX_FREQUENCY, rate / 2))
    axes.set_yticks([0, 1000, 2000, 3000, 4000] if rate >= 8000 else [0, rate / 2])
    axes.yaxis.set_major_formatter(lambda value, _: f"{value / 1000:g}")
    axes.set_title(
        as_shown(
            f"{recording.surface} {recording.take}\n"
            f"{recording.known('label')} {recording.scenario}"
        ),
        fontsize=10,
    )
    axes.tick_params(labelsize=8)
    axes.set_xlabel("s", fontsize=8)
    return image
