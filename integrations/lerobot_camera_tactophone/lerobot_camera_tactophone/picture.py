"""The picture: bands of contact and air over time, and a strip of what the detector
says.

Rows 0-103 are the contact microphone, 104-207 the air microphone, low at the bottom of
each; a column is 8.9 ms, the newest at the right. Rows 208-215 are roughness and
216-223 amplitude, as grey. All is grey, as video codecs keep the colour of every fourth
pixel.
"""

import numpy as np
from numpy.typing import NDArray

from tactophone import LIVE_SAMPLE_RATE, Prediction

SIZE = 224
"""Rows and columns, as most policies take them."""

SECONDS = 2.0
BANDS = 104
STRIP = 8
"""Rows of each line of the strip, a block of the codec's."""

LOWEST, HIGHEST = 60.0, 20_000.0
"""Hz of the bands."""

QUIETEST, LOUDEST = -90.0, -10.0
"""dBFS of black and white."""

WINDOW = 1024
HOP = round(SECONDS * LIVE_SAMPLE_RATE / SIZE)

Pixels = NDArray[np.uint8]


def _bands() -> NDArray[np.float32]:
    """Return the share of each bin in each band, ``(bins, BANDS)``; narrow bands are
    interpolated."""
    bins = np.fft.rfftfreq(WINDOW, 1 / LIVE_SAMPLE_RATE)
    edges = np.geomspace(LOWEST, HIGHEST, BANDS + 1)
    centres, half = (
        np.sqrt(edges[:-1] * edges[1:]),
        np.maximum(np.diff(edges) / 2, bins[1]),
    )
    shares = np.clip(1 - np.abs(bins[:, None] - centres) / half, 0, None)
    return (shares / shares.sum(0)).astype(np.float32)


class Picture:
    """Draws sound as it comes."""

    def __init__(self) -> None:
        self.pixels: Pixels = np.zeros((SIZE, SIZE), np.uint8)
        self._bands, self._window = _bands(), np.hanning(WINDOW).astype(np.float32)
        self._gain = 4 / self._window.sum() ** 2
        self._waiting = np.zeros((WINDOW - HOP, 2), np.float32)
        self._felt = np.zeros(2)

    def feel(self, prediction: Prediction, amplitude: float) -> None:
        """Take the newest prediction, and the amplitude of its command."""
        rough = prediction.roughness if prediction.touch else 0.0
        self._felt = np.nan_to_num(np.array([rough, amplitude]))

    def hear(self, samples: NDArray[np.float32]) -> None:
        """Take sound of shape ``(samples, 2)``, contact and air, at 48 kHz."""
        waiting = np.concatenate([self._waiting, samples])
        count = (len(waiting) - WINDOW) // HOP + 1 if len(waiting) >= WINDOW else 0
        if count > SIZE:  # older than the picture
            waiting, count = waiting[(count - SIZE) * HOP :], SIZE
        if count:
            frames = np.stack(
                [waiting[k * HOP : k * HOP + WINDOW] for k in range(count)]
            )
            self._add(frames * self._window[:, None])
        self._waiting = waiting[count * HOP :]

    def _add(self, frames: NDArray[np.float32]) -> None:
        spectrum = np.fft.rfft(frames, axis=1)
        power = (spectrum.real**2 + spectrum.imag**2).astype(np.float32)
        levels = 10 * np.log10(
            np.einsum("kbc,bn->kcn", power, self._bands, optimize=True) * self._gain
            + 1e-12
        )
        grey = np.clip((levels - QUIETEST) / (LOUDEST - QUIETEST), 0, 1)
        columns = np.zeros((SIZE, len(frames)))
        columns[:BANDS], columns[BANDS : 2 * BANDS] = (
            grey[:, 0, ::-1].T,
            grey[:, 1, ::-1].T,
        )
        columns[2 * BANDS :] = np.repeat(np.clip(self._felt, 0, 1), STRIP)[:, None]
        self.pixels = np.concatenate(
            [self.pixels[:, len(frames) :], np.uint8(np.round(255 * columns))], axis=1
        )

    @property
    def rgb(self) -> Pixels:
        """The picture of this moment, ``(SIZE, SIZE, 3)``."""
        return np.repeat(self.pixels[:, :, None], 3, axis=2)
