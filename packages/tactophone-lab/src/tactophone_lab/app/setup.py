"""Fit a detector to a new finger from a few minutes of its sound."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from tactophone.app.check import Step, record_act
from tactophone.app.sources import AudioInput
from tactophone.core.errors import ModelError
from tactophone.core.settings import Settings
from tactophone.core.types import AudioBlock, ignore
from tactophone.signal.perception.calibration import Finding
from tactophone.signal.perception.model_file import read_model
from tactophone.signal.perception.models import (
    default_model,
    model_path,
    open_touch_detector,
)
from tactophone.signal.perception.noise_floor import measure_floor
from tactophone_lab.app.object_sounds import SLIDE, ObjectSounds, record_objects

if TYPE_CHECKING:
    from tactophone_lab.training.finger_fit import SetUpFit

SMOOTH = ("polished marble", "whiteboard")
"""Smooth objects that the simulated finger slides over, where nothing is named."""

ROUGH = ("brick", "lava stone")
"""Rough objects that it slides over."""

KIND = "texture"
"""Kind of model that can be fitted."""


@dataclass(frozen=True, slots=True, eq=False)
class SetUpSounds:
    """The sounds of a set-up, and which of its objects are rough."""

    recorded: ObjectSounds
    rough: tuple[bool, ...]
    """Of each object."""


def record_set_up(
    settings: Settings,
    smooth: Sequence[str] = SMOOTH,
    rough: Sequence[str] = ROUGH,
    *,
    seconds: float = SLIDE,
    step: Step = record_act,
    begin: Callable[[int, AudioInput], None] = ignore,
) -> SetUpSounds:
    """Record silence, and sliding on smooth and rough objects, as `record_objects`."""
    objects = [
        (name, f"Slide to and fro on {name} ({label}), now fast, now slowly")
        for label, names in (("smooth", smooth), ("rough", rough))
        for name in names
    ]
    recorded = record_objects(
        settings, objects, seconds=seconds, step=step, begin=begin
    )
    return SetUpSounds(recorded, (False,) * len(smooth) + (True,) * len(rough))


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
    not a texture model or the silence was not steady. Read
    `ObjectSounds.findings` first: they say whether the microphones work.
    """
    from tactophone_lab.training.finger_fit import collect, fit_set_up, write_set_up

    name = model or default_model(tip)
    recorded = sounds.recorded
    rate = recorded.sample_rate
    start = model_path(name)
    original = read_model(start)
    check_kind(name)
    silence = [AudioBlock(original.card.heard(recorded.silence), rate)]
    floor = measure_floor(silence, sample_rate=rate, rule=original.card.gate.rule)
    if not floor.known:
        raise ModelError(
            "the silence was not steady: keep the finger and the table still, and run "
            "setup again"
        )
    threshold = floor.threshold_dbfs
    collected = []
    labelled = zip(recorded.objects, sounds.rough, strict=True)
    for number, ((each, samples), rough) in enumerate(labelled, 1):
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
    findings = recorded.findings() + _misfits(name, recorded, threshold_dbfs=threshold)
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


def _misfits(
    name: str, sounds: ObjectSounds, *, threshold_dbfs: float
) -> list[Finding]:
    """Return what of the sound does not fit a shipped model: a missing band, noise,
    another tip."""
    detector = open_touch_detector(
        name, sample_rate=sounds.sample_rate, contact="window"
    )
    detector.threshold.dbfs = threshold_dbfs
    sound = np.concatenate((sounds.silence, *(each for _, each in sounds.objects)))
    detector.push(AudioBlock(sound, sounds.sample_rate))
    misfit = (
        detector.misfit
        if detector.misfit and detector.misfit.code != "undecided"
        else None
    )  # what setup mends
    return [Finding(misfit.code, misfit.text, fatal=False)] if misfit else []
