"""Recording of guided steps: an instruction, level meters, and so many seconds of sound."""

from collections.abc import Iterator

import numpy as np

from tactophone.cli._support.audio_input import SETTLING, AudioInput, SimulatedAct
from tactophone.cli._support.guide_screen import GuideScreen
from tactophone.cli._support.meters import Meters
from tactophone.errors import DatasetError
from tactophone.types import AudioBlock, FloatArray


def record_step(
    audio: AudioInput, blocks: Iterator[AudioBlock], act: SimulatedAct, instruction: str,
    *, meters: Meters, screen: GuideScreen, wait: bool,
) -> FloatArray:  # fmt: skip
    """Give an instruction, wait for an answer if ``wait``, and return the sound, ``(samples, channels)``.

    Raises `DatasetError` if the sound ends too early.
    """
    if wait:
        _await_key(blocks, meters, screen, instruction)
    audio.ask(SimulatedAct(act.verb, act.duration + SETTLING))
    rate = audio.source.sample_rate
    _collect(blocks, SETTLING, rate, meters, screen, instruction)
    return _collect(blocks, act.duration, rate, meters, screen, instruction)


def _await_key(blocks: Iterator[AudioBlock], meters: Meters, screen: GuideScreen, instruction: str) -> None:
    screen.offer({"start": "Start"})
    while True:
        meters.push(next(blocks))
        if meters.due():
            screen.show(meters, instruction, "press a key to start")
        if screen.pressed():
            screen.offer({})
            return


def _collect(
    blocks: Iterator[AudioBlock], duration: float, rate: int, meters: Meters, screen: GuideScreen, instruction: str
) -> FloatArray:
    """Return ``duration`` s of sound, shape ``(samples, channels)``."""
    parts: list[FloatArray] = []
    left = round(duration * rate)
    for block in blocks:
        parts.append(block.samples[:left])
        meters.push(block)
        left -= len(parts[-1])
        if left <= 0:
            return np.concatenate(parts)
        if meters.due():
            screen.show(meters, instruction, f"{left / rate:.1f} s")
    raise DatasetError(f"the sound ended {left / rate:.1f} s too early; use a source that goes on until the last step")
