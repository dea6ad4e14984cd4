"""Heights as a figure: the map, and a profile before and after the filter."""

from pathlib import Path

import numpy as np

from tactophone.dataset.height_map import HeightReport, Heights, levelled
from tactophone.dataset.roughness import roughness_profile
from tactophone.plotting import BLUE, GREY, VERMILION, load_pyplot


def draw_heights(path: Path, heights: Heights, report: HeightReport, *, title: str) -> None:
    """Draw heights in um over place in mm, with the parameters in the title, as PNG.

    Raises `TactophoneError` if matplotlib is not installed.
    """
    pyplot = load_pyplot()
    rows = np.atleast_2d(levelled(heights))
    is_map = len(rows) > 1
    figure, panels = pyplot.subplots(1 + is_map, 1, figsize=(9, 6 if is_map else 3), layout="constrained", dpi=110)
    axes = np.atleast_1d(panels)
    length, width = 1e3 * report.step * rows.shape[1], 1e3 * report.step * len(rows)
    if is_map:
        image = axes[0].imshow(1e6 * rows, extent=(0, length, width, 0), cmap="viridis", aspect="equal")
        axes[0].axhline(width / 2, color=VERMILION, linewidth=0.8)
        axes[0].set_ylabel("mm")
        axes[0].set_anchor("W")
        figure.colorbar(image, cax=axes[0].inset_axes((1.03, 0, 0.03, 1)), label="um")
    middle = rows[len(rows) // 2]
    rough = roughness_profile(middle, step=report.step, cutoff=report.cutoff)
    place = 1e3 * report.step * np.arange(len(middle))
    trimmed = (len(middle) - len(rough)) // 2
    axes[-1].plot(place, 1e6 * middle, color=GREY, linewidth=0.8, label="levelled")
    axes[-1].plot(
        place[trimmed : trimmed + len(rough)], 1e6 * rough, color=BLUE, linewidth=0.8, label="roughness, filtered"
    )
    axes[-1].set(xlabel="mm", ylabel="um")
    axes[-1].legend(frameon=False, fontsize=8, loc="upper right", ncols=2)
    found = report.profile
    words = f"Ra {1e6 * found.ra:.3g} um, Rq {1e6 * found.rq:.3g} um, Rz {1e6 * found.rz:.3g} um, "
    figure.suptitle(f"{title}: {words}RSm {1e3 * found.rsm:.3g} mm, cut-off {1e3 * report.cutoff:g} mm", fontsize=10)
    figure.savefig(path)
    pyplot.close(figure)
