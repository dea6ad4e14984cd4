"""Draws docs/images/wiring.svg: which part is connected to which. ``python
hardware/wiring.py [OUT.svg]``."""

import argparse
import sys
from pathlib import Path

BOXES = {
    "piezo": (20, 50, "piezo disc", "glued inside the pad"),
    "mems": (20, 150, "MEMS microphone", "on the nail, port to the tip"),
    "card": (250, 100, "sound card, robot", "two inputs, 48 kHz"),
    "robot": (470, 100, "tactophone send", "robot"),
    "operator": (470, 250, "tactophone receive", "operator"),
    "out": (250, 250, "sound card, operator", "output 1"),
    "amp": (20, 250, "small amplifier", "volume at its lowest first"),
    "coil": (20, 350, "voice coil", "on the fingertip"),
}
"""Left, top, title and note of each box."""

WIRES = (
    ("piezo", "card", "input 1, INST: ceramic to tip, brass to sleeve"),
    ("mems", "card", "input 2, INST: AC to tip, GND to sleeve; Vin 3 V"),
    ("card", "robot", "USB"),
    ("robot", "operator", "UDP 48470, encrypted"),
    ("operator", "out", "USB"),
    ("out", "amp", "left to tip, ground to sleeve"),
    ("amp", "coil", "+ and -, twisted; polarity does not matter"),
)
WIDTH = 170
"""Width of a box in the drawing, in units of the SVG."""

HEIGHT = 50
"""Height of a box in the drawing."""


def draw() -> str:
    """Return the drawing."""
    parts = [
        '<svg xmlns="http://www.w3.org/2000/svg" viewBox="0 0 780 420" '
        'font-family="sans-serif" font-size="13">',
        '<rect width="780" height="420" fill="#ffffff"/>',
    ]
    for begin, end, words in WIRES:
        parts += _wire(BOXES[begin][:2], BOXES[end][:2], words)
    for left, top, title, note in BOXES.values():
        middle = left + WIDTH / 2
        parts.append(
            f'<rect x="{left}" y="{top}" width="{WIDTH}" height="{HEIGHT}" rx="6" '
            'fill="#eef4f9" stroke="#0072B2"/>'
        )
        parts.append(
            f'<text x="{middle}" y="{top + 21}" text-anchor="middle">{title}</text>'
        )
        parts.append(
            f'<text x="{middle}" y="{top + 39}" text-anchor="middle" font-size="11" '
            f'fill="#555">{note}</text>'
        )
    return "\n".join([*parts, "</svg>", ""])


def _wire(begin: tuple[int, int], end: tuple[int, int], words: str) -> list[str]:
    """Draw a line between the facing sides of two boxes, with its words beside the
    middle."""
    if begin[0] == end[0]:
        x = begin[0] + WIDTH / 2
        points = (x, begin[1] + HEIGHT, x, end[1])
        place, anchor = (x + 6, (begin[1] + HEIGHT + end[1]) / 2 + 4), "start"
    else:
        right = begin[0] < end[0]
        points = (
            begin[0] + WIDTH * right,
            begin[1] + HEIGHT / 2,
            end[0] + WIDTH * (not right),
            end[1] + HEIGHT / 2,
        )
        place, anchor = ((points[0] + points[2]) / 2, points[1] - 31), "middle"
        if points[1] != points[3]:
            place, anchor = (
                (points[0] + 10, points[1] + (-12 if points[1] < points[3] else 20)),
                "start",
            )
    x0, y0, x1, y1 = points
    return [
        f'<line x1="{x0}" y1="{y0}" x2="{x1}" y2="{y1}" stroke="#555" '
        'stroke-width="1.5"/>',
        f'<text x="{place[0]}" y="{place[1]}" text-anchor="{anchor}" font-size="10" '
        f'fill="#333">{words}</text>',
    ]


if __name__ == "__main__":
    parser = argparse.ArgumentParser(
        description="draw which part is connected to which, as SVG"
    )
    default = Path(__file__).parent.parent / "docs" / "images" / "wiring.svg"
    parser.add_argument(
        "target", nargs="?", type=Path, default=default, metavar="OUT.svg"
    )
    target = parser.parse_args().target
    target.write_text(draw(), encoding="utf-8")
    sys.stdout.write(f"{target}\n")
