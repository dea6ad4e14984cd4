"""Whether the sound of a touch fits the model: a missing band, noise, another tip.

The windows that the detector classifies are summed up in half-octave bands, those of
touch and those of silence apart. After noise and gain are removed, touch is compared
with simulated touch of the model's tip, and of soft and hard tips: Gaussians, wider the
less has been heard, which ``benchmarks/tip_sounds.py`` fits and writes to
``models/tips.npz``. A notice is for people: it changes nothing that is rendered, and it
ends when the sound fits again.
"""

import functools
from collections.abc import Mapping
from pathlib import Path
from types import MappingProxyType
from typing import NamedTuple, Protocol, runtime_checkable

import numpy as np
from numpy.typing import NDArray

from tactophone.core.tips import TIPS
from tactophone.core.types import FloatArray

Floats = NDArray[np.float64]

EDGES = np.geomspace(100, 7000, 13)
"""Bounds of the bands in Hz; the resampler's own low-pass begins over the highest."""

FIT_SPACING = 3
"""Every third window is taken, one in 30 ms: they hardly overlap."""

LEAST = 15
"""Windows of touch before the first verdict: 0.45 s."""

EVERY = 8
"""Windows of touch from one verdict to the next: 0.24 s."""

LONG = 60
"""Windows of touch, 1.8 s, before a verdict on noise, or on the tip while noise is
unknown."""

TOUCH_MEMORY = 160
"""Windows of touch, 4.8 s, after which the weight of one has fallen to 1/e."""

NOISE_MEMORY = 60
"""Windows of silence, 1.8 s, after which the weight of one has fallen to 1/e."""

RINGING = 10
"""Windows after a touch, 0.3 s, that are no silence yet."""

LEAST_NOISE = 15
"""Windows of silence, 0.45 s, from which its noise is known."""

SILENT_DB = -115.0
"""Where the loudest band is fainter, there is no signal; digital silence has -120
dB."""

MISSING_DB = 20.0
"""By how much, at least, each band over a cut-off is fainter than under the tip, beside
the bands under it."""

UNDECIDED_SHARE = 0.4
"""Share of undecided windows of a touch (`is_undecided`) over which that is noticed."""

UNDECIDED_MEMORY = 300
"""Windows, 3 s as every one counts here, over which that share is measured."""

LEAST_BANDS = 3
"""Bands under a cut-off."""

AUDIBLE_DB = 3.0
"""From so far over the noise a band of a touch can be heard."""

AUDIBLE_SHARE = 0.4
"""Noise hides a touch that can be heard in less than this share of the bands. Simulated
touches have 0.42 or more in a quiet room, soft rubber the least."""

RANGE_DB = 40.0
"""So far under a channel's loudest band, levels are not told apart."""

ANOTHER: Mapping[str, tuple[float, float]] = MappingProxyType(
    {"both": (4.0, 30.0), "contact": (1.0, 50.0), "air": (4.0, 20.0)}
)
"""Logarithm of the likelihood ratio from which, twice in a row, sound is of another
tip; under 0 it is the model's own again. And how far from that tip's mean, by the
logarithm of its likelihood, sound is of no tip: speech, a motor. For both microphones,
and for one alone, of a soft tip's model and of a hard one's."""


class Misfit(NamedTuple):
    """What does not fit: a code for programs, and a sentence with the next step."""

    code: str
    text: str


@runtime_checkable
class ChecksFit(Protocol):
    """A detector that says whether the sound fits its model; those of other packages
    need not."""

    @property
    def misfit(self) -> Misfit | None:
        """What about the sound does not fit now."""


@functools.cache
def _tips() -> dict[str, Floats]:
    """Return for each microphone of `ANOTHER` the ``means``, soft tips before hard
    ones, and the covariance of all.

    In the coordinates ``values @ basis`` it is diagonal: 1, and ``within / n`` more for
    a description of ``n`` windows.
    """
    with np.load(Path(__file__).parent / "models" / "tips.npz") as file:
        return {name: np.asarray(file[name], np.float64) for name in file.files}


@functools.cache
def _taper_power_and_bounds(
    size: int, sample_rate: int
) -> tuple[Floats, float, NDArray[np.intp]]:
    taper = np.hanning(size + 1)[:-1]
    bounds = np.searchsorted(np.fft.rfftfreq(size, 1 / sample_rate), EDGES)
    return taper, np.square(taper).sum() * size / 2, bounds


def is_undecided(none: float, smooth: float, rough: float) -> bool:
    """Whether a window says nothing: no class is twice as likely as the other, or it is
    unlike training.

    >>> is_undecided(0.0, 0.4, 0.6), is_undecided(0.0, 0.3, 0.7)
    (True, False)
    """
    return none >= 0.5 or (smooth < 2 * rough and rough < 2 * smooth)


def _decibels(powers: Floats) -> Floats:
    return np.asarray(10 * np.log10(powers + 1e-12))


class FitCheck:
    """Sums up the windows of touch and of silence, and says what does not fit.

    ``name`` and ``tip`` are the model's; without a tip no sound is known to compare
    with, as that of a user's own model. ``air``: its only channel is the air
    microphone.

    - ``tip``: the tip whose sound is expected; empty where none is known.
    - ``air``: as given.
    - ``misfit``: what does not fit now, the first cause of several.
    """

    def __init__(
        self, name: str, sample_rate: int, *, tip: str = "", air: bool = False
    ) -> None:
        self._name = name
        self._sample_rate = sample_rate
        # Read now, as a run may open no file once it goes. A tip whose sound is not in
        # the file is not compared.
        known = [*TIPS][: len(_tips()["both-means"])]
        self.tip = tip if tip in known else ""
        self.air = air
        self.reset()

    def reset(self) -> None:
        """Return to the initial state: nothing is known of touch and noise."""
        self.misfit: Misfit | None = None
        self._number = self._touched = self._quiet = self._against = 0
        self._since = RINGING
        self._decided_on = 0
        self._undecided = 0.0
        # Running means over windows of touch: levels, their squares, impulses of the
        # slope.
        self._touch: tuple[Floats, ...] = (np.zeros(1),) * 3
        self._noise = np.zeros(1)

    def push(self, sound: FloatArray, *, touching: bool) -> None:
        """Take the next window, ``(channels, samples)``."""
        self._number += 1
        if self._number % FIT_SPACING:
            return
        level = self._band_levels(sound)
        if level.max() < SILENT_DB:
            return
        self._since = 0 if touching else self._since + 1
        if not self._since:
            self._touched += 1
            weight = max(1 / self._touched, 1 / TOUCH_MEMORY)
            new = level, np.square(level), _impulses(sound[:, 1:] - sound[:, :-1])
            self._touch = tuple(
                old + weight * (each - old)
                for old, each in zip(self._touch, new, strict=True)
            )
            if self._touched >= LEAST and self._touched % EVERY == 0:
                self.misfit = self._judge()
        elif self._since > RINGING:
            self._quiet += 1
            self._noise = self._noise + max(1 / self._quiet, 1 / NOISE_MEMORY) * (
                level - self._noise
            )

    def hear(self, probabilities: tuple[float, float, float]) -> None:
        """Take what the model made of a window of touch."""
        self._decided_on = min(self._decided_on + 1, UNDECIDED_MEMORY)
        self._undecided += (
            float(is_undecided(*probabilities)) - self._undecided
        ) / self._decided_on

    def description(self) -> tuple[Floats, int]:
        """Return touch less noise, whatever the gains, in dB for each channel heard,
        and the number of its windows.

        Levels in the bands less their mean; their standard deviation; and three
        measures of impulses.
        """
        heard = self._heard()
        levels = self._levels()
        level, square, impulses = self._touch
        shape = np.maximum(levels, levels.max(axis=1, keepdims=True) - RANGE_DB)
        shape -= shape.mean(axis=1, keepdims=True)
        deviation = np.sqrt(np.maximum(square - np.square(level), 0.01))[heard]
        values = np.concatenate(
            (shape.ravel(), deviation.ravel(), impulses[heard].ravel())
        )
        return values, min(self._touched, TOUCH_MEMORY)

    def _band_levels(self, sound: FloatArray) -> Floats:
        """Return the level of each channel in each band, ``(channels, bands)``."""
        taper, power, bounds = _taper_power_and_bounds(
            sound.shape[1], self._sample_rate
        )
        powers = np.square(np.abs(np.fft.rfft(sound * taper))) / power
        return _decibels(np.add.reduceat(powers, bounds, axis=1)[:, :-1])

    def _heard(self) -> NDArray[np.bool_]:
        return np.asarray(self._touch[0].max(axis=1) > SILENT_DB)

    def _levels(self) -> Floats:
        touch = 10 ** (self._touch[0][self._heard()] / 10)
        noise = (
            10 ** (self._noise[self._heard()] / 10)
            if self._quiet >= LEAST_NOISE
            else np.zeros(1)
        )
        return _decibels(np.maximum(touch - noise, noise / 4))

    def _judge(self) -> Misfit | None:
        if not self._heard().any():
            return None
        if self.tip and (highest := self._cut_off()):
            return Misfit(
                "narrow-band",
                f"no sound above {highest / 1000:.1f} kHz: the model {self._name} "
                "needs up to "
                f"{EDGES[-1] / 1000:g} kHz; switch off what limits it (a headset, "
                "noise reduction, a codec), or train "
                "on your microphone",
            )
        known = self._quiet >= LEAST_NOISE
        long = self._touched >= LONG
        if known and long:
            over = (self._touch[0] - self._noise)[self._heard()]
            if (over > AUDIBLE_DB).mean() < AUDIBLE_SHARE:
                return Misfit(
                    "noisy",
                    f"touch is hardly {AUDIBLE_DB:g} dB over the noise, too little to "
                    "tell smooth from rough; press "
                    "harder, turn the gain up, or keep motors and fans away",
                )
        if self.tip and (known or long) and (other := self._other_tip()):
            return other
        if self._decided_on < UNDECIDED_MEMORY or self._undecided <= UNDECIDED_SHARE:
            return None
        return Misfit(
            "undecided",
            f"the model {self._name} cannot tell smooth from rough in over "
            f"{UNDECIDED_SHARE:.0%} of this touch; let "
            "`tactophone setup` measure your finger on a smooth and a rough object",
        )

    def _microphones(self) -> str:
        if self._heard().sum() > 1:
            return "both"
        return "air" if self.air else "contact"

    def _cut_off(self) -> float:
        """Return the frequency over which each channel lacks what touch has under this
        tip; 0 if there is none."""
        levels = self._levels()
        means = _tips()[f"{self._microphones()}-means"][[*TIPS].index(self.tip)]
        off = levels - means[: levels.size].reshape(levels.shape)
        for band in range(LEAST_BANDS, off.shape[1]):
            if (
                off[:, band:].max(axis=1) < off[:, :band].mean(axis=1) - MISSING_DB
            ).all():
                return float(EDGES[band])
        return 0.0

    def _other_tip(self) -> Misfit | None:
        microphones = self._microphones()
        means, basis, within = (
            _tips()[f"{microphones}-{each}"] for each in ("means", "basis", "within")
        )
        values, windows = self.description()
        likelihoods = (
            -(np.square((values - means) @ basis) / (1 + within / windows)).sum(axis=1)
            / 2
        )
        own = TIPS[self.tip]
        tips = list(TIPS.values())[: len(_tips()["both-means"])]
        rows = [
            *tips,
            *tips[-1:] * (len(means) - len(tips)),
        ]  # one microphone has further rows of the last tip
        others = np.array([tip.hard != own.hard for tip in rows])
        # Of one kind, a pad is told from rubber alone, by both microphones, and nothing
        # else: a soft thing under a pad sounds like a hard one under rubber.
        others |= np.array([tip.impulses > own.impulses for tip in rows]) & (
            microphones == "both"
        )
        likeliest = likelihoods[others].max()
        (least, farthest) = ANOTHER[microphones]
        ratio = likeliest - likelihoods[~others].max()
        self._against = (
            self._against + 1 if ratio > least and likeliest > -farthest else 0
        )
        noticed = (
            self.misfit is not None and self.misfit.code == "other-tip" and ratio > 0
        )
        if self._against < 2 and not noticed:
            return None
        best = rows[np.where(others, likelihoods, -np.inf).argmax()]
        kind, other = ("hard" if tip.hard else "soft" for tip in (own, best))
        return Misfit(
            "other-tip",
            f"this sounds like {'another' if kind == other else 'a'} {other} tip, but "
            f"the model {self._name} is for a "
            f"{kind} one, {own.name}: if so, "
            + " or ".join(
                f"--tip {tip.name}"
                for tip in tips
                if tip.hard == best.hard and tip is not own
            ),
        )


def _impulses(slopes: FloatArray) -> Floats:
    """Return crest, kurtosis and mean absolute value of each channel, all by its RMS:
    ``(channels, 3)``, in dB."""
    sizes = np.abs(slopes)
    squares = np.square(slopes)
    # The means of all in one call, and not by `mean`, which takes five times as long
    # for so few.
    mean, power, fourth = (
        np.add.reduce((sizes, squares, np.square(squares)), axis=2) / slopes.shape[1]
    )
    power += 1e-18
    measures = (
        np.square(np.maximum.reduce(sizes, axis=1)) / power,
        np.square(mean) / power,
        fourth / np.square(power),
    )
    return _decibels(np.array(measures).T)
