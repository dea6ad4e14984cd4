"""A recording as models expect it: without a channel that is silent, an offset or mains
hum, and loud enough.

A recording can be read twice. So what a live run only reports as a fault of a
microphone is corrected here: a microphone in one channel of a stereo file, a
converter's offset, hum of a cable, a gain far from any in training.
"""

from collections.abc import Iterator
from dataclasses import dataclass, replace
from typing import Self

import numpy as np
from msgspec import structs

from tactophone.app.hum import Hum, HumMeter
from tactophone.core.tips import TIPS
from tactophone.core.types import AudioBlock, ChangedSource, Source
from tactophone.signal.perception import health

SILENT_CHANNEL = 1e-6
"""Greatest sample, -120 dBFS, of a channel that no microphone was connected to: a
twentieth of the last bit of 16."""

LEAST_OFFSET = 1e-3
"""Mean of a channel, -60 dBFS, from which it is removed: a smaller one moves no
feature, and sound stays bit-equal."""

QUIET_DBFS = -50.0
"""Banded level of the loudest 32 ms under which sound is amplified: in training it is
-10 to -44 dBFS."""

LEVEL_DBFS = -35.0
"""Level to which it is amplified: in the middle of the training levels."""

MOST_GAIN_DB = 60.0
"""Largest amplification (dB): a larger one would only amplify the converter's noise."""

TRAINED_HUM_DBFS = -30.0
"""Upper limit of the hum that models are trained with, except models for a hard tip: it
is the hum of the simulated contact microphone. Without it they are right 0.02 less
often (docs/research/contact.md)."""

_MEASURED = (health.FaultKind.CLIPPED, health.FaultKind.OFFSET, health.FaultKind.HUM)
"""Faults that a preparation measures itself, so that it need not repeat them."""


@dataclass(frozen=True, slots=True)
class Preparation:
    """What is changed in a recording."""

    channels: tuple[int, ...]
    """Numbers of the channels that are kept."""
    offset: tuple[float, ...]
    """Mean of each of these, which is removed; 0 where it is negligible."""
    gain_db: float = 0.0
    """Gain of all channels."""
    hum: Hum | None = None
    """Hum to subtract from all channels of the source, if any."""
    invalid: int = 0
    """Samples that are no sound (`AudioBlock.invalid`); the detector withholds its
    predictions there."""
    clipped: float = 0.0
    """Share of the samples of a channel, the one that has most, that are cut off;
    floats may go over 1."""
    faults: tuple[health.SensorFault, ...] = ()
    """Other faults of the microphones that a live run would report; they are only
    said."""

    @classmethod
    def of(cls, source: Source) -> Self:
        """Read a source to its end, and return everything to change except the gain."""
        peak, total, railed = np.zeros((3, source.channels))
        count = invalid = 0
        meter = HumMeter(source.sample_rate, source.channels)
        detector = health.FaultDetector(source.sample_rate)
        faults: dict[health.SensorFault, None] = {}
        sounding = frozenset[int]()
        with source:
            for block in source:
                peak = np.maximum(peak, np.abs(block.samples).max(axis=0, initial=0.0))
                samples = block.samples
                if block.invalid is not None:
                    invalid += int(block.invalid.any(axis=1).sum())
                total += samples.sum(axis=0, dtype=np.float64)
                railed += health.clipped_samples(samples.T).sum(axis=1)
                count += block.size
                meter.push(samples)
                if source.sample_rate >= health.TREBLE_LOWEST_RATE and detector.push(
                    block
                ):
                    sounding |= detector.sounding
                    faults |= dict.fromkeys(
                        fault
                        for fault in detector.faults
                        if fault.kind not in _MEASURED
                    )
        # An input is open where nothing but its own noise came from it in the whole
        # recording, while the other one sounded.
        silent_kinds = (health.FaultKind.DEAD, health.FaultKind.OPEN)
        opened = {fault.channel for fault in faults if fault.kind in silent_kinds}
        live = tuple(
            channel
            for channel in np.flatnonzero(peak >= SILENT_CHANNEL).tolist()
            if channel in sounding or channel not in opened
        )
        channels = live or tuple(range(source.channels))
        mean = total / max(count, 1)
        offset = tuple(
            float(mean[at]) if abs(mean[at]) >= LEAST_OFFSET else 0.0 for at in channels
        )
        clipped = float(np.max(railed, where=peak <= 1, initial=0.0)) / max(count, 1)
        return cls(
            channels,
            offset,
            hum=meter.hum(),
            invalid=invalid,
            clipped=clipped,
            faults=tuple(faults),
        )

    def for_tip(self, tip: str) -> Self:
        """Return this without the subtraction of hum that models for ``tip`` were
        trained with; an empty ``tip`` is unknown."""
        if (
            self.hum is None
            or self.hum.level_dbfs >= TRAINED_HUM_DBFS
            or (tip in TIPS and TIPS[tip].hard)
        ):
            return self
        return replace(self, hum=None)

    def amplified(self, loudest_dbfs: float) -> Self:
        """Return this with the gain for sound whose loudest 32 ms have this banded
        level."""
        quiet = loudest_dbfs < QUIET_DBFS and loudest_dbfs > LEVEL_DBFS - MOST_GAIN_DB
        return replace(self, gain_db=LEVEL_DBFS - loudest_dbfs if quiet else 0.0)

    def notes(self, channels: int, *, used: int = 2) -> list[str]:
        """Return sentences on a recording with ``channels`` channels, for a model that
        takes ``used`` of them."""
        notes = []
        if len(self.channels) == channels:
            notes += [
                str(fault)
                for fault in self.faults
                if used > 1 or fault.kind is not health.FaultKind.ALIKE
            ]
        else:
            notes.append(
                f"channel {2 - self.channels[0]} of 2 has no microphone: taken as a "
                "recording of one channel"
            )
        if self.invalid:
            notes.append(
                f"{self.invalid} x no sound (no number, or over 8 times full scale), "
                "and silence around it: scale "
                "a file of floats to -1 to 1"
            )
        if self.clipped > health.FAULT_CLIPPED_SHARE:
            notes.append(
                f"{100 * self.clipped:.1f} % of the sound is clipped: record it again "
                "with less gain"
            )
        if any(self.offset):
            notes.append(
                f"an offset of {max(self.offset, key=abs):+.3f} of full scale was "
                "removed"
            )
        if self.hum:
            notes.append(
                f"hum of {self.hum.mains} Hz mains at {self.hum.level_dbfs:.0f} dBFS "
                "was removed: see the cables"
            )
        if self.gain_db:
            notes.append(
                f"very quiet: amplified by {self.gain_db:.0f} dB; record with more gain"
            )
        return notes


class PreparedSource(ChangedSource):
    """A source with the changes of a preparation; a
    :class:`~tactophone.core.types.Source` itself.

    >>> from tactophone.live.audio.files import FileSource
    >>> def prepared(path):
    ...     return PreparedSource(FileSource(path), Preparation.of(FileSource(path)))
    """

    def __init__(self, source: Source, preparation: Preparation) -> None:
        super().__init__(source)
        self.channels = len(preparation.channels)
        self._channels = (
            list(preparation.channels) if self.channels < source.channels else None
        )
        self._offset = np.array(preparation.offset, np.float32)
        self._gain = np.float32(10 ** (preparation.gain_db / 20))
        self._hum = preparation.hum

    def __iter__(self) -> Iterator[AudioBlock]:
        self._position = 0
        return map(self._prepared, self._source)

    def _prepared(self, block: AudioBlock) -> AudioBlock:
        if self._hum:
            hum = self._hum.waveform(self._position, block.size)
            self._position += block.size
            block = structs.replace(block, samples=block.samples - hum)
        if self._channels is not None:
            block = block.select(self._channels)
        samples = block.samples
        if self._offset.any():
            samples = samples - self._offset
        if self._gain != 1:
            samples = samples * self._gain
        if samples is block.samples:
            return block
        return structs.replace(block, samples=samples)
