"""Recording of guided steps: an instruction, level meters, and so many seconds of sound."""

from collections.abc import Iterator

import numpy as np
from rich.console import Group
from rich.live import Live
from rich.text import Text

from tactophone.cli._support import keyboard
from tactophone.cli._support.audio_input import SETTLING, AudioInput, SimulatedAct
from tactophone.cli._support.meters import Meters
from tactophone.errors import DatasetError
from tactophone.types import AudioBlock, FloatArray


def record_step(
    audio: AudioInput, blocks: Iterator[AudioBlock], act: SimulatedAct, instruction: str,
    *, meters: Meters, live: Live | None, wait: bool,
) -> FloatArray:  # fmt: skip
    """Give an instruction, wait for a key if ``wait``, and return the sound, shape ``(samples, channels)``.

    Raises
    ------
    DatasetError
        If the sound ends too early.
    """
    if wait:
        _await_key(blocks, meters, live, instruction)
    audio.ask(SimulatedAct(act.verb, act.duration + SETTLING))
    rate = audio.source.sample_rate
    _collect(blocks, SETTLING, rate, meters, live, instruction)
    return _collect(blocks, act.duration, rate, meters, live, instruction)


def _await_key(blocks: Iterator[AudioBlock], meters: Meters, live: Live | None, instruction: str) -> None:
    while True:
        meters.push(next(blocks))
        if meters.due():
            _show(live, meters, instruction, "press a key to start")
        if keyboard.read_key(0):
            return


def _collect(
    blocks: Iterator[AudioBlock], duration: float, rate: int, meters: Meters, live: Live | None, instruction: str
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
            _show(live, meters, instruction, f"{left / rate:.1f} s")
    raise DatasetError(f"the sound ended {left / rate:.1f} s too early; use a source that goes on until the last step")


def _show(live: Live | None, meters: Meters, instruction: str, state: str) -> None:
    if live is not None:
        live.update(
            Group(Text(instruction, style="bold"), *meters.rows(), Text(f" {state}", style="cyan")), refresh=True
        )
