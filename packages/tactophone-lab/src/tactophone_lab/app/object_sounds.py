"""Record silence, and strokes on one object after the other, as a person is told to."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np

from tactophone.app.check import SILENCE, Step, now, record_act
from tactophone.app.sources import AudioInput, SimulatedAct
from tactophone.core.settings import Settings
from tactophone.core.types import FloatArray, ignore
from tactophone.signal.perception.calibration import (
    CalibrationSounds,
    Finding,
    measure_calibration,
)

SLIDE = 10.0
"""Seconds of sliding on each object."""

NOT_ASKED = ("no-tap", "faint-stroke")
"""Findings of a calibration that are about steps which are not part of this."""


@dataclass(frozen=True, slots=True, eq=False)
class ObjectSounds:
    """The sound of silence, and each object's name and sound."""

    sample_rate: int
    source: str
    silence: FloatArray
    objects: list[tuple[str, FloatArray]]

    def findings(self) -> list[Finding]:
        """Return what is wrong with the microphones, by the sounds of all objects."""
        strokes = np.concatenate([sound for _, sound in self.objects])
        sounds = CalibrationSounds(
            self.sample_rate, self.silence, strokes, self.objects[0][1]
        )
        result = measure_calibration(sounds, made=now(), source=self.source)
        return [finding for finding in result.findings if finding.code not in NOT_ASKED]


def record_objects(
    settings: Settings,
    objects: Sequence[tuple[str, str]],
    *,
    seconds: float = SLIDE,
    step: Step = record_act,
    begin: Callable[[int, AudioInput], None] = ignore,
) -> ObjectSounds:
    """Record silence, and sliding on each object, given by its name and an instruction;
    of the simulated finger, names of the catalogue.

    ``begin`` is called before each step: silence is step 1, and a number beyond the
    last object means the end.
    """
    recorded: list[tuple[str, FloatArray]] = []
    with AudioInput(settings, objects[0][0]) as audio:
        begin(1, audio)
        blocks = iter(audio)
        silence = step(
            audio,
            blocks,
            SimulatedAct("rest", SILENCE),
            "Silence: touch nothing and keep still",
        )
        for number, (name, words) in enumerate(objects):
            begin(2 + number, audio)
            act = SimulatedAct("stroke", seconds)
            if number and audio.name == "finger":
                # A simulated finger lies on one object; the same seed gives the same
                # set-up on the next.
                with AudioInput(settings, name) as other:
                    sound = step(other, iter(other), act, words)
            else:
                sound = step(audio, blocks, act, words)
            recorded.append((name, sound))
        begin(2 + len(objects), audio)
        return ObjectSounds(audio.source.sample_rate, audio.name, silence, recorded)
