"""Draws docs/images/tactophone.webp from a real run: ``tactophone demo``, then
``scripts/moving_picture.py [DEMO]``.

Left, the simulated finger where it was at each moment (the same seed moves it again);
in the middle, the sound on its way; right, the fingertip with the vibration that the
run rendered; below, its drive over time, coloured by what was rendered and as tall as
it was strong.
"""

import argparse
import csv
from pathlib import Path

import numpy as np
from PIL import Image, ImageDraw, ImageFont

from tactophone.app.figures import TOUCH_COLOURS
from tactophone.core.types import Touch
from tactophone_lab.simulation.demonstration import demonstration

SIZE = (880, 400)
"""Width and height of the picture in pixels."""

SCALE = 2
"""How much larger each frame is drawn before it is reduced, to smooth edges."""

RATE = 10
"""Frames a second."""

BEGIN = 1.4
"""Second of the run at which the picture begins."""

END = 11.9
"""Second of the run at which the picture ends."""

SHOWN = 4.0
"""Seconds that the strip below shows at once."""

# The background is transparent, so the colours are legible on white and on black.
INK = "#6b7785"
PALE = "#7d8894"
STONE = "#b9b3a8"
SKIN = "#dcab8c"
GREY = "#aab4bd"

COLOURS = 64
"""Few enough for a small file."""

FLOOR = 236
WORDS = {Touch.NONE: "no contact", Touch.SMOOTH: "smooth", Touch.ROUGH: "rough"}


class Canvas:
    """Draws in pixels of the final picture."""

    def __init__(self) -> None:
        self.image = Image.new("RGBA", (SIZE[0] * SCALE, SIZE[1] * SCALE), f"{INK}00")
        self._draw = ImageDraw.Draw(self.image)

    def box(
        self,
        left: float,
        top: float,
        right: float,
        bottom: float,
        radius: float,
        fill: str,
    ) -> None:
        place = [SCALE * edge for edge in (left, top, right, bottom)]
        self._draw.rounded_rectangle(place, SCALE * radius, fill)

    def dot(self, x: float, y: float, radius: float, fill: str) -> None:
        self._draw.ellipse(
            [SCALE * edge for edge in (x - radius, y - radius, x + radius, y + radius)],
            fill,
        )

    def arc(self, x: float, y: float, radius: float, fill: str, width: float) -> None:
        place = [
            SCALE * edge for edge in (x - radius, y - radius, x + radius, y + radius)
        ]
        self._draw.arc(place, -35, 35, fill, round(SCALE * width))

    def bar(self, x: float, low: float, high: float, fill: str) -> None:
        self._draw.line(
            [SCALE * x, SCALE * low, SCALE * x, SCALE * high], fill, SCALE * 2
        )

    def text(
        self,
        x: float,
        y: float,
        words: str,
        size: int,
        fill: str = INK,
        anchor: str = "mm",
    ) -> None:
        self._draw.text(
            (SCALE * x, SCALE * y),
            words,
            fill,
            ImageFont.load_default(SCALE * size),
            anchor=anchor,
        )


def finger_path() -> tuple[np.ndarray, np.ndarray]:
    """Return the finger's place in m, and the stone that it touches or -1, one value a
    frame."""
    finger, places, stones = demonstration(), [], []
    size = finger.sample_rate // RATE
    for _ in range(int(END * RATE) + 1):
        finger.render(size)
        places.append(float(finger.truth.x[-1]))
        stones.append(int(finger.truth.object_index[-1]))
    return np.array(places), np.array(stones)


def draw(folder: Path) -> list[Image.Image]:
    with (folder / "timeline.csv").open(newline="") as file:
        rows = list(csv.DictReader(file))
    times = np.array([float(row["time"]) for row in rows])
    touches = [Touch[row["touch"].upper()] for row in rows]
    places, stones = finger_path()
    shown = [
        min(int(np.searchsorted(times, k / 40)), len(rows) - 1)
        for k in range(int(times[-1] * 40))
    ]
    low, high = places.min(), places.max()
    across = 60 + 230 * (places - low) / (high - low)
    touched = [across[stones == stone] for stone in np.unique(stones[stones >= 0])[:2]]
    frames = []
    for k in range(int(BEGIN * RATE), int(END * RATE)):
        now = k / RATE
        row = min(int(np.searchsorted(times, now, "right")) - 1, len(rows) - 1)
        touch, amplitude = touches[row], float(rows[row]["amplitude"])
        colour = TOUCH_COLOURS[touch] if touch is not Touch.NONE else GREY
        canvas = Canvas()
        canvas.text(170, 28, "the robot's finger", 17)
        canvas.text(450, 28, "sound, encrypted, over a bad network", 13, PALE)
        canvas.text(720, 28, "your fingertip", 17)
        # Two stones: the demonstration strokes the first, then the second.
        for number, under in enumerate(touched):
            left, right = under.min() - 24, under.max() + 24
            canvas.box(left, FLOOR - 40, right, FLOOR, 16, STONE)
            for bump, place in enumerate(
                np.arange(left + 14, right - 10, 10.3) if number else ()
            ):
                canvas.dot(place, FLOOR - 40 + 2.5 * (bump % 3), 5 + bump % 2, STONE)
        x = across[k]
        y = FLOOR - 44 if stones[k] >= 0 else FLOOR - 66
        canvas.box(x - 17, y - 100, x + 17, y, 17, "#8a93a1")
        canvas.box(x - 17, y - 26, x + 17, y, 15, "#4c8ed9")
        canvas.dot(x + 34, y - 14, 6, "#c8553d")
        if touch is not Touch.NONE:
            for ring in range(5):
                radius = 20 + (28 * ring + 140 * now) % 140
                canvas.arc(
                    370, FLOOR - 90, radius, colour, 3 if touch is Touch.ROUGH else 1.5
                )
        shake = 26 * amplitude * (1 if k % 2 else -1)
        for glow in (3, 2, 1) if touch is not Touch.NONE else ():
            canvas.dot(
                720 + shake,
                150,
                46 + 11 * glow,
                f"{colour}{round(255 * (0.28 / glow + 0.05)):02x}",
            )
        canvas.box(682 + shake, 106, 758 + shake, 262, 38, SKIN)
        canvas.box(700 + shake, 112, 740 + shake, 150, 17, "#f6e3d6")
        canvas.box(690 + shake, 160, 750 + shake, 182, 6, colour)
        frequency = f"{float(rows[row]['frequency']):.0f} Hz" if amplitude else "silent"
        canvas.text(
            784, 232, WORDS[touch], 19, INK if touch is not Touch.NONE else PALE, "lm"
        )
        canvas.text(784, 254, frequency, 14, PALE, "lm")
        for step in range(int(SHOWN * 40)):
            moment = round(now * 40) - int(SHOWN * 40) + step
            if 0 <= moment < len(shown):
                tall, felt = (
                    1 + 90 * float(rows[shown[moment]]["amplitude"]),
                    touches[shown[moment]],
                )
                shade = TOUCH_COLOURS[felt] if felt is not Touch.NONE else GREY
                canvas.bar(40 + 5 * step, 330 - tall, 330 + tall, shade)
        canvas.text(40, 388, "drive of the voice coil", 11, PALE, "lm")
        canvas.text(840, 388, "a simulated run, as it was rendered", 11, PALE, "rm")
        smoothed = (
            canvas.image.convert("RGBa")
            .resize(SIZE, Image.Resampling.LANCZOS)
            .convert("RGBA")
        )
        frames.append(
            smoothed.quantize(COLOURS, method=Image.Quantize.FASTOCTREE).convert("RGBA")
        )
    return frames


if __name__ == "__main__":
    parser = argparse.ArgumentParser(
        description="draw the README's moving picture from a demonstration"
    )
    parser.add_argument(
        "demo",
        nargs="?",
        type=Path,
        default=Path("demo"),
        help="folder that `tactophone demo` wrote",
    )
    parser.add_argument("--out", type=Path, default=Path("docs/images/tactophone.webp"))
    args = parser.parse_args()
    pictures = draw(args.demo)
    pictures[0].save(
        args.out,
        save_all=True,
        append_images=pictures[1:],
        duration=1000 // RATE,
        loop=0,
        lossless=True,
        method=3,
    )
