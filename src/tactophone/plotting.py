"""What all figures share: matplotlib, loaded only when needed, and one set of colours.

The colours are those of Okabe and Ito (2008), which stay distinct for every kind of colour vision.
"""

from typing import Any

from tactophone.errors import TactophoneError
from tactophone.types import Touch

BLUE, ORANGE, GREEN, VERMILION = "#0072B2", "#E69F00", "#009E73", "#D55E00"
PURPLE = "#CC79A7"
GREY = "#8C8C8C"
"""For what is absent; not one of Okabe and Ito's."""

TOUCH_COLOURS = {Touch.NONE: "#E4E4E4", Touch.SMOOTH: "#56B4E9", Touch.ROUGH: VERMILION}

_STYLE: Any = {
    "font.size": 9,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.labelcolor": "#333333",
    "axes.edgecolor": "#999999",
    "xtick.color": "#555555",
    "ytick.color": "#555555",
}


def load_pyplot() -> Any:
    """Import matplotlib's pyplot with the project's style, for files only (no window).

    Raises `TactophoneError` if matplotlib is not installed.
    """
    try:
        import matplotlib as mpl  # slow to import, and only figures need it
    except ImportError as error:
        raise TactophoneError("figures need matplotlib: pip install 'tactophone[plot]'") from error
    mpl.use("Agg")
    from matplotlib import pyplot

    pyplot.rcParams.update(_STYLE)
    return pyplot
