"""Injects microphone faults into the sound of another source, each for a span of time.

Faults are named as in `tactophone.signal.perception.health`, such as ``air-dead``;
``swapped`` and ``alike`` concern both microphones.
"""

import re
from collections.abc import Callable, Iterable, Iterator, Mapping
from dataclasses import dataclass
from functools import partial
from typing import Self

import numpy as np
from numpy.typing import NDArray
from scipy import signal

from tactophone.core.errors import ConfigError
from tactophone.core.microphones import AIR, CONTACT
from tactophone.core.types import AudioBlock, ChangedSource, Source

HUM_DBFS = -15.0
"""Level of the simulated mains hum in dBFS."""

MAINS = 50.0
"""Frequency of the simulated mains in Hz."""

SIMULATED_OFFSET = 0.2
"""Constant offset of a faulty input, as a share of full scale."""

OVERDRIVE_DB = (35.0, 65.0)
"""Excess gain of contact and air: even noise reaches full scale."""

CASE_CORNER = 300.0
"""Hz over which a closed plastic case attenuates by 12 dB an octave."""

CASE_LOSS_DB = 12.0
"""Broadband loss of the same case in dB."""

SELF_NOISE_DBFS = -72.0
"""Self-noise of a MEMS microphone at the simulated finger's gain."""

FaultFunction = Callable[[NDArray[np.float64], "_FaultState"], None]

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

        Raises `ConfigError` if the code is unknown or the times make no sense.
        """
        match = _SPAN.fullmatch(text)
        if not match or match["code"] not in CODES:
            raise ConfigError(
                f"{text!r} is not a fault; write CODE@START-END in seconds, CODE one "
                f"of {', '.join(CODES)}"
            )
        return cls(
            match["code"], float(match["start"] or 0), float(match["end"] or "inf")
        )


class FaultySource(ChangedSource):
    """Another source's sound with faults; the samples do not depend on the block
    size."""

    def __init__(self, source: Source, faults: Iterable[FaultSpan]) -> None:
        super().__init__(source)
        self._faults = [(span, _FaultState(source.sample_rate)) for span in faults]

    def __iter__(self) -> Iterator[AudioBlock]:
        return map(self.apply, self._source)

    def apply(self, block: AudioBlock) -> AudioBlock:
        samples = block.samples.astype(np.float64)
        for span, state in self._faults:
            first = round(
                np.clip(span.start * block.sample_rate - block.start, 0, block.size)
            )
            last = round(
                np.clip(span.end * block.sample_rate - block.start, 0, block.size)
            )
            if first < last:
                state.position = block.start + first
                _FAULTS[span.code](samples[first:last], state)
        clipped = samples.clip(-1.0, 1.0).astype(np.float32)
        return AudioBlock(clipped, block.sample_rate, block.start, block.concealed)


class _FaultState:
    """A fault's state from one block to the next."""

    def __init__(self, sample_rate: int) -> None:
        self.rate = sample_rate
        self.position = 0
        self.rng = np.random.default_rng(0xFA17)
        self.sections = signal.butter(2, CASE_CORNER, fs=sample_rate, output="sos")
        self.filter = np.zeros((1, 2))


def _dead(samples: NDArray[np.float64], _: _FaultState, channel: int) -> None:
    samples[:, channel] = 0.0


def _clipped(samples: NDArray[np.float64], _: _FaultState, channel: int) -> None:
    samples[:, channel] = (
        samples[:, channel] * 10 ** (OVERDRIVE_DB[channel] / 20)
    ).clip(-1, 1)


def _offset(samples: NDArray[np.float64], _: _FaultState, channel: int) -> None:
    samples[:, channel] += SIMULATED_OFFSET


def _hum(samples: NDArray[np.float64], state: _FaultState, channel: int) -> None:
    phase = 2 * np.pi * MAINS * (state.position + np.arange(len(samples))) / state.rate
    wave = np.sin(phase) + 0.5 * np.sin(3 * phase)
    samples[:, channel] += 10 ** (HUM_DBFS / 20) * wave / np.sqrt((1 + 0.5**2) / 2)


def _covered(samples: NDArray[np.float64], state: _FaultState) -> None:
    muffled, state.filter = signal.sosfilt(
        state.sections, samples[:, AIR], zi=state.filter
    )
    noise = 10 ** (SELF_NOISE_DBFS / 20) * state.rng.standard_normal(len(samples))
    samples[:, AIR] = muffled * 10 ** (-CASE_LOSS_DB / 20) + noise


def _swapped(samples: NDArray[np.float64], _: _FaultState) -> None:
    samples[:] = samples[:, ::-1].copy()


def _alike(samples: NDArray[np.float64], _: _FaultState) -> None:
    samples[:, AIR] = samples[:, CONTACT]


_FAULTS: Mapping[str, FaultFunction] = {
    **{
        f"{name}-{kind}": partial(function, channel=channel)
        for channel, name in ((CONTACT, "contact"), (AIR, "air"))
        for kind, function in (
            ("dead", _dead),
            ("clipped", _clipped),
            ("offset", _offset),
            ("hum", _hum),
        )
    },
    "air-covered": _covered,
    "swapped": _swapped,
    "alike": _alike,
}

CODES = tuple(_FAULTS)
"""The code of every fault."""
