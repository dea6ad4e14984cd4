"""Breaks microphones on purpose: another source's sound, with a fault from one time to another.

Faults are named as in :mod:`tactophone.perception.sensor_health.faults`: ``air-dead``; ``swapped`` and ``alike`` concern both.
"""

import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from types import MappingProxyType, TracebackType
from typing import Self

import numpy as np
from numpy.typing import NDArray
from scipy import signal

from tactophone.errors import ConfigError
from tactophone.types import AIR, CONTACT, AudioBlock, Source

HUM_DBFS = -15.0
OFFSET = 0.2
OVERDRIVE_DB = (35.0, 65.0)
"""More gain than any sensible one, for contact and air: even noise reaches full scale."""

CASE_CORNER = 300.0
"""Hz over which a closed plastic case lets less and less through, 12 dB an octave."""

CASE_LOSS_DB = 12.0
SELF_NOISE_DBFS = -72.0
"""Of a MEMS microphone at the simulated finger's gain: what is left when it hears nothing."""

Breakage = Callable[[NDArray[np.float64], "_Shape"], None]

_SPAN = re.compile(r"(?P<code>[a-z-]+)(?:@(?P<start>[\d.]+)(?:-(?P<end>[\d.]+))?)?")


@dataclass(frozen=True, slots=True)
class FaultSpan:
    """A fault's code, and when it begins and ends in s.

    >>> FaultSpan.parse("air-dead@3-5")
    FaultSpan(code='air-dead', start=3.0, end=5.0)
    """

    code: str
    start: float = 0.0
    end: float = float("inf")

    @classmethod
    def parse(cls, text: str) -> Self:
        """Read ``code``, ``code@start`` or ``code@start-end``, times in s.

        Raises
        ------
        ConfigError
            If the code is unknown or the times make no sense.
        """
        match = _SPAN.fullmatch(text)
        if not match or match["code"] not in CODES:
            raise ConfigError(f"{text!r} is no fault; write CODE@START-END in seconds, CODE one of {', '.join(CODES)}")
        return cls(match["code"], float(match["start"] or 0), float(match["end"] or "inf"))


class FaultySource:
    """Another source's sound, with faults in it; the same samples at any block size."""

    def __init__(self, source: Source, faults: Iterable[FaultSpan]) -> None:
        self._source = source
        self._faults = [(span, _Shape(source.sample_rate)) for span in faults]

    @property
    def sample_rate(self) -> int:
        """In Hz."""
        return self._source.sample_rate

    @property
    def channels(self) -> int:
        """As the source has them."""
        return self._source.channels

    def __enter__(self) -> Self:
        self._source.__enter__()
        return self

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self._source.__exit__(kind, error, trace)

    def __iter__(self) -> Iterator[AudioBlock]:
        for block in self._source:
            yield self.break_block(block)

    def break_block(self, block: AudioBlock) -> AudioBlock:
        """Give a block as the faulty microphones would have heard it."""
        samples = block.samples.astype(np.float64)
        for span, shape in self._faults:
            first = round(np.clip(span.start * block.sample_rate - block.start, 0, block.size))
            last = round(np.clip(span.end * block.sample_rate - block.start, 0, block.size))
            if first < last:
                shape.position = block.start + first
                _BREAKAGES[span.code](samples[first:last], shape)
        heard = samples.clip(-1.0, 1.0).astype(np.float32)
        return AudioBlock(heard, block.sample_rate, block.start, block.concealed)


class _Shape:
    """What a fault needs to go on from one block to the next."""

    def __init__(self, sample_rate: int) -> None:
        self.rate = sample_rate
        self.position = 0
        self.rng = np.random.default_rng(0xFA17)
        self.sections = signal.butter(2, CASE_CORNER, fs=sample_rate, output="sos")
        self.state = np.zeros((1, 2))


def _dead(channel: int) -> Breakage:
    def breakage(samples: NDArray[np.float64], _: _Shape) -> None:
        samples[:, channel] = 0.0

    return breakage


def _clipped(channel: int) -> Breakage:
    def breakage(samples: NDArray[np.float64], _: _Shape) -> None:
        samples[:, channel] = (samples[:, channel] * 10 ** (OVERDRIVE_DB[channel] / 20)).clip(-1, 1)

    return breakage


def _offset(channel: int) -> Breakage:
    def breakage(samples: NDArray[np.float64], _: _Shape) -> None:
        samples[:, channel] += OFFSET

    return breakage


def _hum(channel: int, mains: float = 50.0) -> Breakage:
    def breakage(samples: NDArray[np.float64], shape: _Shape) -> None:
        phase = 2 * np.pi * mains * (shape.position + np.arange(len(samples))) / shape.rate
        wave = np.sin(phase) + 0.5 * np.sin(3 * phase)
        samples[:, channel] += 10 ** (HUM_DBFS / 20) * wave / np.sqrt((1 + 0.5**2) / 2)

    return breakage


def _covered(samples: NDArray[np.float64], shape: _Shape) -> None:
    muffled, shape.state = signal.sosfilt(shape.sections, samples[:, AIR], zi=shape.state)
    noise = 10 ** (SELF_NOISE_DBFS / 20) * shape.rng.standard_normal(len(samples))
    samples[:, AIR] = muffled * 10 ** (-CASE_LOSS_DB / 20) + noise


def _swapped(samples: NDArray[np.float64], _: _Shape) -> None:
    samples[:] = samples[:, ::-1].copy()


def _alike(samples: NDArray[np.float64], _: _Shape) -> None:
    samples[:, AIR] = samples[:, CONTACT]


_BREAKAGES: Mapping[str, Breakage] = MappingProxyType(
    {
        **{
            f"{name}-{kind}": make(channel)
            for channel, name in ((CONTACT, "contact"), (AIR, "air"))
            for kind, make in (("dead", _dead), ("clipped", _clipped), ("offset", _offset), ("hum", _hum))
        },
        "air-covered": _covered,
        "swapped": _swapped,
        "alike": _alike,
    }
)

CODES = tuple(_BREAKAGES)
"""Every fault that can be made."""
