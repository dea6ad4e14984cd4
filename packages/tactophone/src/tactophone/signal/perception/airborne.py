"""What of the contact microphone's sound may have come through the air.

Speech and music reach the contact microphone too, only much fainter than the air
microphone. A touch does the opposite: it is louder in the contact microphone. So the
two microphones together tell what one alone cannot. `AirborneSound` says how loud the
sound of the air may be in each band of the contact microphone, and `ContactGate` takes
only what is louder for a touch.

How much fainter sound from the air is depends on the mounting, and nobody has measured
it on a fingertip. It is taken to be `ISOLATION_DB` or more.

Only what is loud in the air microphone over its own noise floor counts. The steady
noise of a hall is in the noise floor of the contact microphone already, and would hide
soft strokes if it were counted twice.
"""

import math

import numpy as np

from tactophone.core.types import FloatArray
from tactophone.signal.perception.levels import (
    BANDS,
    BANDS_HOP,
    SLOW,
    BandLevels,
    LoudnessRule,
    band_weights,
    level_power,
)
from tactophone.signal.perception.noise_floor import (
    BAND_MARGIN_DB,
    FLOOR_SILENT_DBFS,
    SPREAD_DB,
    Floats,
    NoiseFloor,
)

ISOLATION_DB = 13.0
"""Least dB by which sound from the air is quieter in the contact microphone. With the
5 dB by which a band has to exceed it, a band counts as touch while the air microphone
is up to 8 dB louder there. That lies in the middle between touches and airborne sound:
in simulated touches the air microphone is at least 3 dB quieter (p99.9 of the pad's
worst band), and with airborne sound 20 dB louder, if the disc is bare
(docs/research/contact.md)."""

MOST_BLOCKS = 64
"""Blocks that are kept as they came until they are asked about: joining costs as much
as a look."""

_SILENT_DBFS = -200.0
"""Level under every sound: bands in which nothing comes through the air."""


class AirborneSound:
    """Keeps the newest sound of an air microphone and follows its noise, and says what
    of it the contact microphone may hear.

    It measures only when it is asked to, at the sample that it is asked about.

    - ``rule``: how the level of the contact gate is measured.
    - ``sample_rate``: of the sound to come, in Hz.
    - ``isolation_db``: least dB by which the air's sound is quieter in the contact
      microphone.
    - ``floor``: the noise floor of the air microphone.

    >>> import numpy as np
    >>> air = AirborneSound("banded", sample_rate=48_000)
    >>> air.hear(np.full(4800, 0.001, np.float32))
    >>> air.explains(-60.0, at=4800, seconds=0.032)
    False
    """

    def __init__(self, rule: LoudnessRule, *, sample_rate: int) -> None:
        self.isolation_db = ISOLATION_DB
        self.floor = NoiseFloor(_SILENT_DBFS, spread_db=SPREAD_DB[rule])
        self._rule: LoudnessRule = rule
        self._sample_rate = sample_rate
        self._weights = band_weights(rule, sample_rate)
        self._levels = BandLevels(sample_rate, hop=round(BANDS_HOP * sample_rate))
        self.reset()

    def reset(self) -> None:
        """Return to the initial state: the floor is unknown, and all that the air
        microphone hears may be heard by the other."""
        self.floor.reset()
        # The newest sound, a window or more of it, then the blocks since; and the
        # position in the stream of the sample after them.
        self._sound: FloatArray = np.zeros(self._levels.window, np.float32)
        self._blocks: list[FloatArray] = []
        self._end = 0
        # The newest spectrum, and where it ends: floor and gate ask for the same.
        self._newest = NOTHING
        self._newest_at = -1

    def hear(self, sound: FloatArray) -> None:
        """Take the air microphone's next samples, or silence where there is none."""
        self._blocks.append(sound)
        self._end += len(sound)
        if len(self._blocks) > MOST_BLOCKS:
            self._join()

    def _join(self) -> None:
        kept = self._sound[-self._levels.window :]
        self._sound = np.concatenate((kept, *self._blocks))
        self._blocks = []

    def follow(self, at: int, *, sounding: bool, hops: int) -> None:
        """Let the floor follow the sound up to a sample, so many hops after the last
        time; ``sounding``: whether the contact microphone hears anything over its
        noise."""
        level_dbfs = self._level_dbfs(at, SLOW)
        loud = level_dbfs >= self.floor.threshold_dbfs
        # Silence teaches no floor, so its bands need not be measured.
        audible = level_dbfs > FLOOR_SILENT_DBFS
        self.floor.push(
            level_dbfs,
            self._bands(at) if audible else NOTHING,
            touching=sounding or loud,
            loud=loud,
            hops=hops,
        )

    def explains(self, own_dbfs: float, *, at: int, seconds: float) -> bool:
        """Whether a level of the contact microphone, over so many seconds up to a
        sample, may be that of the air's sound."""
        air_dbfs = self._level_dbfs(at, seconds)
        heard = air_dbfs >= self.floor.threshold_dbfs
        # As of a band, which is heard from the margin on.
        return heard and own_dbfs < air_dbfs - self.isolation_db + BAND_MARGIN_DB

    def in_contact(self, at: int, *, margin_db: float, loud_from: float) -> Floats:
        """Return how loud the sound of the air up to a sample may be in each band of
        the contact microphone, in dBFS.

        A sound counts if it would be loud in the air microphone too: with ``margin_db``
        over its noise a band is heard, from a mean excess of ``loud_from`` dB all of
        them are loud.
        """
        bands = self._bands(at)
        if self.floor.known:
            heard_from = self.floor.bands + margin_db
            if mean_excess_db(bands, heard_from) < loud_from:
                return NOTHING
            bands = np.where(bands > heard_from, bands, _SILENT_DBFS)
        return bands - self.isolation_db

    def share_left(
        self, bands: Floats, at: int, *, margin_db: float, loud_from: float
    ) -> float:
        """Return the share of the contact microphone's level, by the gate's rule, in
        bands that the sound of the air up to a sample does not explain."""
        by_air = self.in_contact(at, margin_db=margin_db, loud_from=loud_from)
        power = self._weights * 10 ** (bands / 10)
        left = float(power[bands > by_air + margin_db].sum() / power.sum())
        return math.sqrt(left) if self._rule == "mean_absolute" else left

    def _bands(self, at: int) -> Floats:
        if at != self._newest_at:
            bands = self._levels.of_window(self._before(at, self._levels.window))
            self._newest = bands.astype(np.float64)
            self._newest_at = at
        return self._newest

    def _level_dbfs(self, at: int, seconds: float) -> float:
        """Return the level over so many seconds up to a sample, by the gate's rule; NaN
        for silence."""
        sound = self._before(at, round(seconds * self._sample_rate))
        if not sound.any():
            return math.nan
        power = level_power(self._rule, sound, self._sample_rate)
        if power <= 0:
            return math.nan
        return (20 if self._rule == "mean_absolute" else 10) * math.log10(power)

    def _before(self, at: int, size: int) -> FloatArray:
        """Return so many samples up to a position in the stream, which is not before
        the newest block."""
        if self._blocks:
            self._join()
        end = len(self._sound) - (self._end - at)
        return self._sound[end - size : end]


def mean_excess_db(bands: Floats, heard_from: Floats) -> float:
    """Return by how many dB bands exceed the levels from which they are heard, in the
    mean over all bands."""
    excess = np.maximum(bands - heard_from, 0.0)
    return float(np.add.reduce(excess)) / BANDS


NOTHING: Floats = np.full(BANDS, _SILENT_DBFS)
"""Of a sound in the air that the contact microphone cannot hear, in each band."""
