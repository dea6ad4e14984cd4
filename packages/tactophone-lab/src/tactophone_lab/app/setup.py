"""Fit a detector to a new finger from a few minutes of its sound."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from tactophone.app.check import SILENCE, Step, now, record_act
from tactophone.app.sources import AudioInput, SimulatedAct
from tactophone.core.errors import ModelError
from tactophone.core.settings import Settings
from tactophone.core.types import AudioBlock, FloatArray, ignore
from tactophone.signal.perception.calibration import (
    CalibrationSounds,
    Finding,
    measure_calibration,
)
from tactophone.signal.perception.model_file import read_model
from tactophone.signal.perception.models import (
    default_model,
    model_path,
    open_touch_detector,
)
from tactophone.signal.perception.noise_floor import measure_floor

if TYPE_CHECKING:
    from tactophone_lab.training.finger_fit import SetUpFit

SLIDE = 10.0
"""Seconds of sliding on each object."""

SMOOTH = ("polished marble", "whiteboard")
"""Smooth objects that the simulated finger slides over, where nothing is named."""

ROUGH = ("brick", "lava stone")
"""Rough objects that it slides over."""

KIND = "texture"
"""Kind of model that can be fitted."""

NOT_ASKED = ("no-tap", "faint-stroke")
"""Findings of a calibration that are about steps which are not part of this."""


@dataclass(frozen=True, slots=True, eq=False)
class SetUpSounds:
    """The sound of a set-up: silence, and each object's name, label (true for rough)
    and sound."""

    sample_rate: int
    source: str
    silence: FloatArray
    objects: list[tuple[str, bool, FloatArray]]

    def findings(self) -> list[Finding]:
        """Return what is wrong with the microphones, by the sounds of all objects."""
        strokes = np.concatenate([sound for _, _, sound in self.objects])
        sounds = CalibrationSounds(
            self.sample_rate, self.silence, strokes, self.objects[0][2]
        )
        result = measure_calibration(sounds, made=now(), source=self.source)
        return [finding for finding in result.findings if finding.code not in NOT_ASKED]


def record_set_up(
    settings: Settings,
    smooth: Sequence[str] = SMOOTH,
    rough: Sequence[str] = ROUGH,
    *,
    seconds: float = SLIDE,
    step: Step = record_act,
    begin: Callable[[int, AudioInput], None] = ignore,
) -> SetUpSounds:
    """Record silence, and sliding on smooth and rough objects; of the simulated finger,
    names of the catalogue.

    ``begin`` is called before each step: silence is step 1, and a number beyond the
    last object means the end.
    """
    objects = [*((name, False) for name in smooth), *((name, True) for name in rough)]
    recorded: list[tuple[str, bool, FloatArray]] = []
    with AudioInput(settings, objects[0][0]) as audio:
        begin(1, audio)
        blocks = iter(audio)
        silence = step(
            audio,
            blocks,
            SimulatedAct("rest", SILENCE),
            "Silence: touch nothing and keep still",
        )
        for number, (name, is_rough) in enumerate(objects):
            begin(2 + number, audio)
            words = (
                f"Slide to and fro on {name} "
                f"({'rough' if is_rough else 'smooth'}), now fast, now slowly"
            )
            act = SimulatedAct("stroke", seconds)
            if number and audio.name == "finger":
                # A simulated finger lies on one object; the same seed gives the same
                # set-up on the next.
                with AudioInput(settings, name) as other:
                    recorded.append(
                        (name, is_rough, step(other, iter(other), act, words))
                    )
            else:
                recorded.append((name, is_rough, step(audio, blocks, act, words)))
        begin(2 + len(objects), audio)
        return SetUpSounds(audio.source.sample_rate, audio.name, silence, recorded)


@dataclass(frozen=True, slots=True)
class Fitted:
    """A model that was fitted, what its file holds, and what was found wrong with the
    microphones."""

    file: Path
    fit: "SetUpFit"
    findings: list[Finding]
    threshold_dbfs: float
    tip: str
    start: str
    """Name of the model that was started from."""

    def as_json(self) -> dict[str, Any]:
        """Return what ``setup --json`` prints."""
        fit = self.fit
        return {
            "passed": True,
            "file": self.file,
            "from": self.start,
            "tip": self.tip,
            "threshold_dbfs": self.threshold_dbfs,
            "score": fit.score,
            "before": fit.balanced_accuracy_before,
            "after": fit.balanced_accuracy,
            "objects": fit.left_out,
            "findings": [finding.message for finding in self.findings],
        }


def fit_finger(
    sounds: SetUpSounds,
    file: Path,
    *,
    tip: str,
    model: str = "",
    report: Callable[[int], None] = ignore,
) -> Fitted:
    """Fit a texture model to a set-up, by default the shipped one for the tip, and
    write it to a file.

    ``report`` is called with the number of objects done. Raises `ModelError` if it is
    not a texture model or the silence was not steady. Read `SetUpSounds.findings`
    first: they say whether the microphones work.
    """
    from tactophone_lab.training.finger_fit import collect, fit_set_up, write_set_up

    name = model or default_model(tip)
    rate = sounds.sample_rate
    start = model_path(name)
    original = read_model(start)
    check_kind(name)
    silence = [AudioBlock(original.card.heard(sounds.silence), rate)]
    floor = measure_floor(silence, sample_rate=rate, rule=original.card.gate.rule)
    if not floor.known:
        raise ModelError(
            "the silence was not steady: keep the finger and the table still, and run "
            "setup again"
        )
    threshold = floor.threshold_dbfs
    collected = []
    for number, (each, rough, samples) in enumerate(sounds.objects, 1):
        collected.append(
            collect(
                original,
                samples,
                sample_rate=rate,
                threshold_dbfs=threshold,
                name=each,
                rough=rough,
            )
        )
        report(number)
    fit = fit_set_up(collected, channels=original.card.channels, tip=tip)
    findings = sounds.findings() + _misfits(name, sounds, threshold_dbfs=threshold)
    write_set_up(file, start, original, fit, threshold_dbfs=threshold, tip=tip)
    return Fitted(file, fit, findings, threshold, tip, original.card.name)


def check_kind(model: str) -> None:
    """Raise `ModelError` for a model whose kind cannot be fitted."""
    card = read_model(model_path(model)).card
    if card.kind != KIND:
        raise ModelError(
            f"model {card.name} has kind {card.kind}; setup fits kind {KIND}: try "
            "--model texture"
        )


def _misfits(name: str, sounds: SetUpSounds, *, threshold_dbfs: float) -> list[Finding]:
    """Return what of the sound does not fit a shipped model: a missing band, noise,
    another tip."""
    detector = open_touch_detector(
        name, sample_rate=sounds.sample_rate, contact="window"
    )
    detector.threshold.dbfs = threshold_dbfs
    sound = np.concatenate((sounds.silence, *(each for _, _, each in sounds.objects)))
    detector.push(AudioBlock(sound, sounds.sample_rate))
    misfit = (
        detector.misfit
        if detector.misfit and detector.misfit.code != "undecided"
        else None
    )  # what setup mends
    return [Finding(misfit.code, misfit.text, fatal=False)] if misfit else []
