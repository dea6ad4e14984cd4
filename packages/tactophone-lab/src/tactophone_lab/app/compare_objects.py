"""Let an operator stroke two objects, and say which is rougher."""

from collections.abc import Callable

import numpy as np

from tactophone.app.check import Step, record_act
from tactophone.app.compare import Comparison, compare
from tactophone.app.sources import AudioInput
from tactophone.core.settings import Settings
from tactophone.core.types import ignore
from tactophone_lab.app.object_sounds import SLIDE, ObjectSounds, record_objects


def record_two(
    settings: Settings,
    first: str,
    second: str,
    *,
    seconds: float = SLIDE,
    step: Step = record_act,
    begin: Callable[[int, AudioInput], None] = ignore,
) -> ObjectSounds:
    """Record silence, and the same strokes on two objects, as `record_objects`."""
    objects = [
        (first, f"Stroke {first} to and fro"),
        (second, f"Stroke {second} in the same way: as fast, as hard"),
    ]
    return record_objects(settings, objects, seconds=seconds, step=step, begin=begin)


def compare_objects(sounds: ObjectSounds, *, tip: str, model: str = "") -> Comparison:
    """Say which of two recorded objects is rougher.

    Read `ObjectSounds.findings` first: they say whether the microphones work.
    """
    # The silence goes before each, and shows the noise that its strokes stand out of.
    first, second = (
        np.concatenate((sounds.silence, sound)) for _, sound in sounds.objects
    )
    return compare(first, second, model, sample_rate=sounds.sample_rate, tip=tip)
