"""How a table and an open recording look in a notebook: a line, and a picture."""

import base64
import html
import importlib.util
import io
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PICTURE_DPI = 80
"""Dots per inch of a picture in a notebook: 9 inches are 720 px, a cell's width."""


def can_draw() -> bool:
    """Return whether the extra ``plot`` is installed."""
    return importlib.util.find_spec("matplotlib") is not None


def cell(line: str, figure: "Figure | None") -> str:
    """Return HTML of a line with a picture below it.

    >>> cell("<Table: 2 predictions>", None)
    '<p><code>&lt;Table: 2 predictions&gt;</code></p>'
    """
    words = f"<p><code>{html.escape(line)}</code></p>"
    if figure is None:
        return words
    file = io.BytesIO()
    figure.savefig(file, format="png", dpi=PICTURE_DPI)
    picture = base64.b64encode(file.getvalue()).decode()
    source = f"data:image/png;base64,{picture}"
    return f'{words}<img alt="{html.escape(line)}" src="{source}">'
