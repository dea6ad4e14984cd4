"""``tactophone finetune``: make a model better on new objects, recorded once, and show what it cost elsewhere."""

import argparse
import math
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from rich.table import Table

from tactophone.cli._support import terminal
from tactophone.cli._support.dataset_options import add_choice, choose
from tactophone.cli.train import prepare_torch
from tactophone.dataset import Dataset, Recording, split
from tactophone.errors import DatasetError
from tactophone.perception import detector_for, model_path, read_model
from tactophone.perception.sensor_health.calibration_file import Calibration
from tactophone.types import Detector

if TYPE_CHECKING:
    from tactophone.evaluation.adaptation import Change
    from tactophone.evaluation.predictions import TakePredictions
    from tactophone.training.finetuning import Material
    from tactophone.training.network.training_job import TrainingJob
    from tactophone.types import FloatArray

REPLAYED, VALIDATED, TESTED = 40, 12, 21
"""Recordings of the general set, at most: with takes of 30 s, all of it takes under five minutes on two cores."""

MOST_LOST = 0.005
"""Balanced accuracy that may be lost on the few validation surfaces, so that not over 0.02 is lost on others."""

HEADINGS = {"balanced_accuracy": "balanced accuracy", "false_positive_rate": "smooth called rough"}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the verb's arguments."""
    parser.add_argument("model", metavar="MODEL", help="model to begin from: a file, or the name of a shipped one")
    parser.add_argument(
        "new", type=Path, metavar="DIR", help="recordings of two or more new objects, two takes or more"
    )
    parser.add_argument(
        "--general", type=Path, required=True, metavar="DIR", help="a general data set: replayed, and tested on"
    )
    parser.add_argument("--out", type=Path, default=Path("adapted.onnx"), metavar="FILE", help="model file to write")
    parser.add_argument(
        "--way", choices=("blend", "fine-tuned"), default="blend",
        help="train on both and mix with the old parameters, or the fine-tuned recipe of the paper",
    )  # fmt: skip
    parser.add_argument("--calibration", type=Path, metavar="FILE", help="contact threshold of the new recordings")
    parser.add_argument("--seed", type=int, default=0, metavar="N", help="of all that is random")
    parser.add_argument("--json", action="store_true", help="print JSON instead of a table")
    add_choice(parser)


def run(args: argparse.Namespace) -> int:
    """Adapt, measure before and after, write the model."""
    prepare_torch()
    from tactophone.training import finetuning as adapt

    began = time.monotonic()
    material = _material(args)
    calibration = Calibration.read(args.calibration) if args.calibration else None
    course = adapt.training_job_for(model_path(args.model), args.way, seed=args.seed, calibration=calibration)
    with terminal.progress("training") as bar:
        task = bar.add_task("", total=None, note="")
        trained = adapt.train_on_both(
            course, material,
            report=lambda told: bar.update(task, completed=told.steps, total=told.of, note=f"loss {told.loss:.3f}"),
        )  # fmt: skip
    share = _choose(args, course, trained, material)
    changes = _measure(args, material, calibration)
    _tell(args, changes, share=share, seconds=time.monotonic() - began)
    return 0


def _material(args: argparse.Namespace) -> "Material":
    from tactophone.training.finetuning import Material, hold_out, thinned

    new, held_out = hold_out(choose(args.new, args.where))
    general = choose(args.general, None)
    rest, test = _part(general)
    replay, validation = _part(general.where(lambda one: one in rest))
    return Material(new, held_out, thinned(replay, REPLAYED), thinned(validation, VALIDATED), thinned(test, TESTED))


def _part(dataset: Dataset) -> tuple[Sequence[Recording], Sequence[Recording]]:
    """Part surfaces: as the data set itself says, or three quarters and one."""
    try:
        fold = split(dataset, "given")[0]
    except DatasetError:
        fold = split(dataset, f"{min(4, len(dataset.surfaces))}-fold")[0]
    return fold.train, fold.test


def _choose(
    args: argparse.Namespace, course: "TrainingJob", trained: "dict[str, FloatArray]", material: "Material"
) -> float:
    """Write the mixture that goes furthest to the new without losing much on the validation surfaces."""
    from tactophone.evaluation.adaptation import accuracy_of
    from tactophone.training.finetuning import mixtures, write_adapted

    start = model_path(args.model)
    facts: dict[str, object] = {
        "way": args.way,
        "new": sorted({one.surface for one in material.new}),
        "takes": len(material.new),
    }
    gate_dbfs = read_model(start).card.gate.threshold_dbfs
    before = accuracy_of(_judge(start, material.validation, "choosing", gate_dbfs))
    best: tuple[float, float] = (-1.0, 0.0)
    with tempfile.TemporaryDirectory() as folder:
        for share, weights in mixtures(start, trained, args.way):
            path = Path(folder) / "mixture.onnx"
            write_adapted(path, course, weights, facts=facts)
            lost = before - accuracy_of(_judge(path, material.validation, f"choosing, {share:.0%} new", gate_dbfs))
            if -lost > best[0] or lost <= MOST_LOST:
                best = (-lost, share)
                write_adapted(args.out, course, weights, facts={**facts, "share": share})
            if lost <= MOST_LOST:
                break
    return best[1]


def _measure(
    args: argparse.Namespace, material: "Material", calibration: Calibration | None
) -> dict[str, dict[str, "Change"]]:
    """Judge before and after, each set with the contact threshold of its own set-up."""
    from tactophone.evaluation.adaptation import by_surface, by_take, compare

    start = model_path(args.model)
    gate_dbfs = read_model(start).card.gate.threshold_dbfs
    parts = {
        "new objects, held-out takes": (
            material.held_out,
            by_take,
            calibration.window_dbfs if calibration else gate_dbfs,
        ),
        "general test set": (material.test, by_surface, gate_dbfs),
    }
    return {
        name: compare(
            *(_judge(path, part, f"{name}, {when}", level) for path, when in ((start, "before"), (args.out, "after"))),
            by=by,
        )
        for name, (part, by, level) in parts.items()
    }


def _judge(path: Path, recordings: Sequence[Recording], note: str, threshold_dbfs: float) -> "list[TakePredictions]":
    from tactophone.evaluation.predictions import predictor_of

    model = read_model(path)

    def opened(rate: int) -> Detector:
        detector = detector_for(model, sample_rate=rate)
        detector.threshold_dbfs = threshold_dbfs
        return detector

    judge = predictor_of(opened, channels=model.card.channels)
    with terminal.progress(note) as bar:
        return [judge(one) for one in bar.track(recordings, task_id=bar.add_task("", note=""))]


def _tell(args: argparse.Namespace, changes: dict[str, dict[str, "Change"]], *, share: float, seconds: float) -> None:
    if args.json:
        told = {name: {key: one.as_json() for key, one in part.items()} for name, part in changes.items()}
        terminal.print_json({**told, "share": share, "seconds": seconds, "file": str(args.out)})
        return
    table = Table("", "before", "after", "change, points", box=None)
    for name, part in changes.items():
        table.add_row(f"[bold]{name}[/]")
        for key, change in part.items():
            if math.isnan(change.before.value):
                table.add_row(f"  {HEADINGS[key]}", "none smooth", "", "")
                continue
            points = [100 * value for value in (change.difference.value, change.difference.low, change.difference.high)]
            drawn = f"{points[0]:+.1f} ({points[1]:+.1f} to {points[2]:+.1f})"
            table.add_row(f"  {HEADINGS[key]}", str(change.before), str(change.after), drawn)
    terminal.out().print(table)
    terminal.out().print(
        f"{share:.0%} of the way to the new objects; {seconds:.0f} s; intervals hold 90 % of the draws"
    )
    new, elsewhere = (
        changes[name]["balanced_accuracy"] for name in ("new objects, held-out takes", "general test set")
    )
    if new.after.value < min(1.0, new.before.value + 1e-9) or elsewhere.difference.value < -0.02:
        terminal.log().print(
            "beware: not better on the new objects, or over 2 points worse elsewhere; keep the old model"
        )
    terminal.out().print(args.out, soft_wrap=True)
