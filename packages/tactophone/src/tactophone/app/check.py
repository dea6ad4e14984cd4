"""Check the microphones: their levels in silence, strokes and taps, and the contact
threshold that follows."""

import datetime
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np

from tactophone.app.sources import SETTLING, AudioInput, SimulatedAct
from tactophone.core.errors import DatasetError
from tactophone.core.settings import Settings
from tactophone.core.types import AudioBlock, FloatArray, ignore
from tactophone.signal.perception.calibration import (
    CalibrationResult,
    CalibrationSounds,
    measure_calibration,
)

SILENCE = 5.0
"""Seconds of silence."""

MOTION = (
    SimulatedAct("move", 10.0),
    "Motion: move the robot in the air all the time, with three starts and stops, "
    "grippers and wrists too. Touch nothing",
)
CHECK_STEPS = (
    (SimulatedAct("rest", SILENCE), "Silence: touch nothing and keep still"),
    (
        SimulatedAct("stroke", 5.0),
        "A stroke: stroke an object that you will use, to and fro, at medium pressure",
    ),
    (SimulatedAct("tap", 3.0), "Taps: tap on it about twice a second"),
)
"""What a check of the microphones asks for; of a robot, `MOTION` too, at the end."""

CHECKED_OBJECT = "smooth competition stone"
"""What the simulated finger strokes in a check, where no smooth object is named."""

Step = Callable[[AudioInput, Iterator[AudioBlock], SimulatedAct, str], FloatArray]
"""Gives an instruction and returns the sound that follows, ``(samples, channels)``; by
default `record_act`."""


def record_act(
    audio: AudioInput,
    blocks: Iterator[AudioBlock],
    act: SimulatedAct,
    instruction: str = "",
    *,
    follow: Callable[[AudioBlock, float], None] = ignore,
) -> FloatArray:
    """Return the sound of an act, ``(samples, channels)``, without the time in which it
    settles.

    ``follow`` is called with each block and the seconds that are left. Raises
    `DatasetError` if the sound ends early.
    """
    audio.ask(SimulatedAct(act.verb, act.duration + SETTLING))
    parts: list[FloatArray] = []
    for duration in (SETTLING, act.duration):
        left = round(duration * audio.source.sample_rate)
        parts = []
        while left > 0:
            if (block := next(blocks, None)) is None:
                seconds = left / audio.source.sample_rate
                raise DatasetError(
                    f"the sound ended {seconds:.1f} s too early; use a source that "
                    "goes on until the last step"
                )
            parts.append(block.samples[:left])
            left -= len(parts[-1])
            follow(block, left / audio.source.sample_rate)
    return np.concatenate(parts)


def check_microphones(
    settings: Settings,
    file: Path,
    *,
    stroked: str = CHECKED_OBJECT,
    false_alarms_per_minute: float = 1.0,
    moving: bool = False,
    step: Step = record_act,
    begin: Callable[[int, AudioInput], None] = ignore,
) -> CalibrationResult:
    """Measure the microphones in silence, strokes and taps; write a calibration file if
    nothing fatal was found.

    Where the finger is a robot's, ``moving``, its motion is heard too. ``begin`` is
    called before each step with its number, from 1, and at the end with the next.
    """
    with AudioInput(settings, stroked) as audio:
        blocks = iter(audio)
        parts = list[FloatArray]()
        for act, instruction in (*CHECK_STEPS, *([MOTION] if moving else [])):
            begin(len(parts) + 1, audio)
            parts.append(step(audio, blocks, act, instruction))
        begin(len(parts) + 1, audio)
        sounds = CalibrationSounds(audio.source.sample_rate, *parts)
        result = measure_calibration(
            sounds,
            made=now(),
            source=audio.name,
            false_alarms_per_minute=false_alarms_per_minute,
        )
    if result.passed:
        result.calibration.write(file)
    return result


def now() -> str:
    return datetime.datetime.now().isoformat(timespec="seconds")
