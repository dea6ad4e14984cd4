"""Whether the sound of a touch fits the model: one microphone on both channels, a missing band, noise, another tip.

The windows that the detector classifies are summed up in half-octave bands, those of touch and those of silence apart.
Less the noise and the gain, touch is compared with simulated touch of the model's tip, and with touch of soft and of
hard tips: Gaussians of one covariance, which ``benchmarks/tip_sounds.py`` fits and writes to ``models/tips.npz``. A
notice is for people: it changes nothing that is rendered, and it ends when the sound fits again.
"""

import functools
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tactophone.microphones import AIR, CONTACT
from tactophone.perception.health import MAX_CORRELATION, FaultKind, SensorFault
from tactophone.types import FloatArray

Floats = NDArray[np.float64]

EDGES = np.geomspace(100, 7000, 13)
"""Bounds of the bands in Hz; the resampler's own low-pass begins over the highest."""

SPACING = 3
"""Every third window is taken, one in 30 ms: they hardly overlap."""

LEAST, EVERY = 60, 15
"""Windows of touch before the first verdict (1.8 s), and from one to the next (0.45 s)."""

TOUCH_MEMORY, NOISE_MEMORY = 160, 60
"""Windows after which the weight of one has fallen to 1/e: 4.8 s and 1.8 s."""

RINGING, LEAST_NOISE = 10, 15
"""Windows after a touch that are no silence yet, and those of silence from which its noise is known."""

MISSING_DB = 20.0
"""By how much, at least, each band over a cut-off is fainter than under the tip, beside the bands under it."""

LEAST_BANDS = 3
"""Bands under a cut-off."""

AUDIBLE_DB, AUDIBLE_SHARE = 3.0, 0.4
"""Noise hides a touch that is 3 dB louder in less than this share of the bands. Simulated touches have 0.42 or more in
a quiet room, soft rubber the least."""

LEVELS_DB: Mapping[str, tuple[tuple[int, ...], tuple[int, ...]]] = MappingProxyType(
    {
        "rubber": ((5, 7, 6, 5, 3, 3, 1, -2, -5, -6, -7, -10), (3, 5, 0, -1, -1, 1, 2, 2, 1, -3, -4, -5)),
        "pad": ((7, 6, 4, 2, 3, 5, 1, -3, -5, -6, -7, -9), (2, 2, 0, 1, 4, 8, 5, 0, -3, -4, -7, -7)),
        "plastic": ((6, 6, 3, 2, 1, 2, 0, -3, -3, -3, -5, -6), (-2, 2, 2, 0, -1, 0, 1, 0, -1, -1, 2, -1)),
        "stylus": ((7, 8, 5, -1, -2, -1, 1, 3, 0, -7, -5, -8), (-1, 4, 5, -2, -3, 1, 3, 2, -1, -1, -4, -3)),
    }
)
"""Levels of touch less noise in the bands, contact and air, less their mean: of each tip on 31 simulated objects."""

RANGE_DB = 40.0
"""So far under a channel's loudest band, levels are not told apart."""

SOFT, HARD = ("rubber", "pad"), ("plastic", "stylus")
"""Only these two kinds are told apart: a soft thing under a pad sounds like a hard one under rubber."""

ANOTHER: Mapping[str, float] = MappingProxyType({"both": 4.0, "contact": 2.0, "air": 6.0})
"""Logarithm of the likelihood ratio from which, twice in a row, sound is of the other kind of tip; under 0 it is the
model's own again. For both microphones, and for one alone, of a soft tip's model and of a hard one's."""


class Misfit(NamedTuple):
    """What does not fit: a code for programs, and a sentence with the next step."""

    code: str
    text: str


@functools.cache
def _tips() -> dict[str, Floats]:
    """Return ``means`` of each microphone's `ANOTHER`, soft tips before hard ones, and the ``precision`` of all."""
    with np.load(Path(__file__).parent / "models" / "tips.npz") as file:
        return {name: np.asarray(file[name], np.float64) for name in file.files}


@functools.cache
def _taper_and_bounds(size: int, sample_rate: int) -> tuple[Floats, NDArray[np.intp]]:
    return np.hanning(size + 1)[:-1], np.searchsorted(np.fft.rfftfreq(size, 1 / sample_rate), EDGES)


def _decibels(powers: Floats) -> Floats:
    return np.asarray(10 * np.log10(powers + 1e-12))


class FitCheck:
    """Sums up the windows of touch and of silence, and says what does not fit.

    ``name`` and ``tip`` are the model's; without a tip no sound is known to compare with, as that of a user's own
    model. ``air``: its only channel is the air microphone.

    Attributes
    ----------
    misfit
        What does not fit now, the first cause of several.
    """

    def __init__(self, name: str, sample_rate: int, *, tip: str = "", air: bool = False) -> None:
        self._name, self._sample_rate, self._tip, self._air = name, sample_rate, tip, air
        self.reset()

    def reset(self) -> None:
        """Return to the initial state: nothing is known of touch and noise."""
        self.misfit: Misfit | None = None
        self._number = self._touched = self._quiet = self._against = 0
        self._since = RINGING
        self._touch = self._level = self._square = self._noise = self._products = np.zeros(1)

    def push(self, sound: FloatArray, *, touching: bool) -> None:
        """Take the next window, ``(channels, samples)``."""
        self._number += 1
        if self._number % SPACING:
            return
        self._since = 0 if touching else self._since + 1
        if touching:
            self._touched += 1
            weight, powers = max(1 / self._touched, 1 / TOUCH_MEMORY), self._powers(sound)
            slopes = np.diff(sound[[CONTACT, -1]])
            products = np.vecdot(slopes[[0, 0, 1]], slopes[[1, 0, 1]])
            self._touch = self._touch + weight * (powers - self._touch)
            level = _decibels(powers)
            self._level = self._level + weight * (level - self._level)
            self._square = self._square + weight * (np.square(level) - self._square)
            self._products = self._products + weight * (products - self._products)
            if self._touched >= LEAST and self._touched % EVERY == 0:
                self.misfit = self._judge(len(sound))
        elif self._since > RINGING:
            self._quiet += 1
            self._noise = self._noise + max(1 / self._quiet, 1 / NOISE_MEMORY) * (self._powers(sound) - self._noise)

    def description(self) -> Floats:
        """Return touch less noise, whatever the gains: ``(3 * bands,)`` of each channel that carries a signal, in dB.

        Levels less their mean; the level of the mean power less the mean level; and the standard deviation of levels.
        """
        heard, levels = self._heard(), self._levels()
        shape = np.maximum(levels, levels.max(axis=1, keepdims=True) - RANGE_DB)
        mean = self._level[heard]
        deviation = np.sqrt(np.maximum(self._square[heard] - np.square(mean), 0.01))
        shape -= shape.mean(axis=1, keepdims=True)
        return np.hstack((shape, _decibels(self._touch[heard]) - mean, deviation)).ravel()

    def _powers(self, sound: FloatArray) -> Floats:
        """Return the mean square of each channel in each band, ``(channels, bands)``."""
        size = sound.shape[1]
        taper, bounds = _taper_and_bounds(size, self._sample_rate)
        powers = np.square(np.abs(np.fft.rfft(sound * taper))) / (np.square(taper).sum() * size / 2)
        return np.asarray(np.add.reduceat(powers, bounds, axis=1)[:, :-1])

    def _heard(self) -> NDArray[np.bool_]:
        return np.asarray(self._touch.sum(axis=1) > 1e-12)

    def _levels(self) -> Floats:
        heard = self._heard()
        noise = self._noise[heard] if self._quiet >= LEAST_NOISE else np.zeros(1)
        return _decibels(np.maximum(self._touch[heard] - noise, noise / 4))

    def _judge(self, channels: int) -> Misfit | None:
        both, first, second = self._products
        if channels > 1 and abs(both) > MAX_CORRELATION * np.sqrt(first * second) > 0:
            return Misfit("alike", str(SensorFault(FaultKind.ALIKE)))
        if not self._heard().any():
            return None
        if self._tip and (highest := self._cut_off()):
            return Misfit(
                "narrow-band",
                f"no sound above {highest / 1000:.1f} kHz: the model {self._name} needs {EDGES[-1] / 1000:g}; switch "
                "off what limits it (a headset, noise reduction, a codec), or train on your microphone",
            )
        if self._quiet >= LEAST_NOISE:
            over = _decibels(self._touch) - _decibels(self._noise)
            if (over > AUDIBLE_DB).mean() < AUDIBLE_SHARE:
                return Misfit(
                    "noisy",
                    f"touch is only {over.mean():.0f} dB over the noise, too little to tell smooth from rough; press "
                    "harder, turn the gain up, or keep motors and fans away",
                )
        return self._other_tip() if self._tip in SOFT + HARD else None

    def _cut_off(self) -> float:
        """Return the frequency over which each channel lacks what touch has under this tip; 0 if there is none."""
        levels = self._levels()
        expected = np.array(LEVELS_DB[self._tip])
        off = levels - (expected if len(levels) > 1 else expected[AIR if self._air else CONTACT])
        for band in range(LEAST_BANDS, off.shape[1]):
            if (off[:, band:].max(axis=1) < off[:, :band].mean(axis=1) - MISSING_DB).all():
                return float(EDGES[band])
        return 0.0

    def _other_tip(self) -> Misfit | None:
        microphones = "both" if self._heard().sum() > 1 else "air" if self._air else "contact"
        off = self.description() - _tips()[f"{microphones}-means"]
        likelihoods = -np.einsum("kd,de,ke->k", off, _tips()[f"{microphones}-precision"], off) / 2
        soft, hard = likelihoods[: len(SOFT)].max(), likelihoods[len(SOFT) :].max()
        own, other, tips, ratio = ("soft", "hard", HARD, hard - soft)
        if self._tip in HARD:
            own, other, tips, ratio = ("hard", "soft", SOFT, soft - hard)
        self._against = self._against + 1 if ratio > ANOTHER[microphones] else 0
        noticed = self.misfit is not None and self.misfit.code == "other-tip" and ratio > 0
        if self._against < 2 and not noticed:
            return None
        return Misfit(
            "other-tip",
            f"this sounds like a {other} tip, but the model {self._name} is for a {own} one, {self._tip}: if so, "
            + " or ".join(f"--tip {tip}" for tip in tips),
        )
