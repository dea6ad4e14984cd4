"""``tactophone finetune``: improve a model on new objects, and show what that costs
elsewhere."""

import argparse
import math
import shutil
import tempfile
import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tactophone.cli import options, output
from tactophone.cli.options import SEED
from tactophone.core.errors import DatasetError
from tactophone.core.processes import atomic_write
from tactophone.core.recordings.values import Dataset, Recording
from tactophone.signal.perception.calibration import Calibration
from tactophone.signal.perception.model_file import read_model
from tactophone.signal.perception.models import model_path
from tactophone_lab.cli.data import add_filter, open_filtered
from tactophone_lab.datasets.splits import split

if TYPE_CHECKING:
    from tactophone.core.types import FloatArray
    from tactophone_lab.evaluation.bootstrap import Change
    from tactophone_lab.evaluation.predict import TakePredictions
    from tactophone_lab.training.finetune import FinetuningData
    from tactophone_lab.training.trainer import NetworkRecipe

REPLAYED, VALIDATED, TESTED = 40, 12, 21
"""Most recordings used of the general set: with takes of 30 s, the whole verb takes
under five minutes on two cores."""

MOST_LOST = 0.005
"""Largest loss of balanced accuracy on the few validation surfaces, so that others lose
at most 0.02."""

HEADINGS = {
    "balanced_accuracy": "balanced accuracy",
    "false_positive_rate": "smooth as rough",
}

EXAMPLES = (
    "tactophone finetune general.onnx recordings --general simulated",
    "tactophone finetune paper recordings --general simulated --strategy fine-tuned --out mine.onnx",
)

NEW, GENERAL = "new objects, held-out takes", "general test set"


def _parts(
    changes: "dict[str, dict[str, Change]]",
    share: float,
    seconds: float,
    file: Path | None,
) -> Iterator[output.Part]:
    rows: list[tuple[Any, ...]] = []
    for name, part in changes.items():
        rows.append((output.styled("bold", name), "", "", ""))
        for key, change in part.items():
            if math.isnan(change.before.value):
                rows.append((f"  {HEADINGS[key]}", "none smooth", "", ""))
                continue
            points = (
                100 * change.difference.value,
                100 * change.difference.low,
                100 * change.difference.high,
            )
            text = (
                "{:+.1f}" if math.isnan(points[1]) else "{:+.1f} ({:+.1f} to {:+.1f})"
            ).format(*points)
            rows.append(
                (f"  {HEADINGS[key]}", str(change.before), str(change.after), text)
            )
    headings = ("", "before", "after", "change, points")
    yield [dict(zip(headings, row, strict=True)) for row in rows]
    yield f"share of the new parameters: {share:.0%}; {seconds:.0f} s; intervals: 90 %"
    new, elsewhere = (changes[name]["balanced_accuracy"] for name in (NEW, GENERAL))
    if (
        new.after.value < min(1.0, new.before.value + 1e-9)
        or elsewhere.difference.value < -0.02
    ):
        output.log().print(
            "warning: no better on the new objects, or 2 points worse elsewhere; keep the old model"
        )
    rate = changes[GENERAL]["false_positive_rate"]
    words = (
        f" elsewhere smooth as rough is now {rate.after} (was {rate.before}); nothing was written: "
        "record smooth objects too, or add --anyway"
    )
    yield str(file) if file else output.styled("red", "refused:", words)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    add(
        "model",
        metavar="MODEL",
        help="model to start from: a file, or the name of a shipped one",
    )
    add(
        "new",
        type=Path,
        metavar="DIR",
        help="recordings of two or more new objects, two takes or more",
    )
    add(
        "--general",
        type=Path,
        required=True,
        metavar="DIR",
        help="general data, to train on again and test with",
    )
    add(
        "--out",
        type=Path,
        default=Path("finetuned.onnx"),
        metavar="FILE",
        help="model file to write",
    )
    add(
        "--strategy",
        choices=("blend", "fine-tuned"),
        default="blend",
        help="train on both and mix with the old parameters, or the paper's own fine-tuning",
    )
    add(
        "--anyway",
        action="store_true",
        help="write it even if smooth feels rough more often on the general data",
    )
    add(
        "--calibration",
        type=Path,
        metavar="FILE",
        help="contact threshold of the new recordings",
    )
    add("--seed", type=SEED, default=0, metavar="N", help="random seed, %(type)s")
    options.add_json(parser, "print JSON instead of a table")
    add_filter(parser)


def run(args: argparse.Namespace) -> int:
    from tactophone_lab.training import finetune

    began = time.monotonic()
    data = _data(args)
    calibration = Calibration.read(args.calibration) if args.calibration else None
    recipe = finetune.finetuning_recipe(
        model_path(args.model), args.strategy, seed=args.seed, calibration=calibration
    )
    with output.progress("training") as update:
        trained = finetune.train_on_both(
            recipe,
            data,
            reading=lambda done, count: update(
                completed=done, total=count, note="reading"
            ),
            report=lambda at: update(
                completed=at.steps, total=at.total, note=f"loss {at.loss:.3f}"
            ),
        )
    out = args.out
    with tempfile.TemporaryDirectory() as folder:
        args.out = Path(folder, out.name)  # until it is known to be good
        share = _choose(args, recipe, trained, data)
        changes = _measure(args, data, calibration)
        rate = changes[GENERAL]["false_positive_rate"]
        if good := args.anyway or not rate.before.is_exceeded_by(rate.after.value):
            with atomic_write(out) as unfinished:
                shutil.copyfile(args.out, unfinished)
    file, seconds = out if good else None, time.monotonic() - began
    values = {**changes, "share": share, "seconds": seconds, "file": file}
    output.show(values, _parts(changes, share, seconds, file), as_json=args.json)
    return 0 if good else 1


def _data(args: argparse.Namespace) -> "FinetuningData":
    from tactophone_lab.training.finetune import FinetuningData, hold_out, thinned

    channels = read_model(model_path(args.model)).card.channels
    new, held_out = hold_out(open_filtered(args.new, args.filter, channels=channels))
    general = open_filtered(args.general, None, channels=channels)
    rest, test = _split(general)
    replay, validation = _split(general.where(lambda recording: recording in rest))
    return FinetuningData(
        new,
        held_out,
        thinned(replay, REPLAYED),
        thinned(validation, VALIDATED),
        thinned(test, TESTED),
    )


def _split(dataset: Dataset) -> tuple[Sequence[Recording], Sequence[Recording]]:
    """Split surfaces: as the data set itself says, or three quarters and one
    quarter."""
    try:
        fold = split(dataset, "predefined")[0]
    except DatasetError:
        fold = split(dataset, f"{min(4, len(dataset.surfaces))}-fold")[0]
    return fold.train, fold.test


def _choose(
    args: argparse.Namespace,
    recipe: "NetworkRecipe",
    trained: "dict[str, FloatArray]",
    data: "FinetuningData",
) -> float:
    """Write the mixture with the largest share of the new without losing much on the
    validation surfaces."""
    from tactophone_lab.evaluation.bootstrap import accuracy_of
    from tactophone_lab.training.finetune import mixtures, write_finetuned

    start = model_path(args.model)
    facts: dict[str, object] = {
        "strategy": args.strategy,
        "new": sorted({recording.surface for recording in data.new}),
        "takes": len(data.new),
    }
    gate_dbfs = read_model(start).card.gate.threshold_dbfs
    before = accuracy_of(_predict(start, data.validation, "choosing", gate_dbfs))
    best: tuple[float, float] = (-math.inf, 0.0)
    for share, weights in mixtures(start, trained, args.strategy):
        path = args.out.with_name(f"tried-{args.out.name}")
        write_finetuned(path, recipe, weights, facts=facts)
        lost = before - accuracy_of(
            _predict(path, data.validation, f"choosing, {share:.0%} new", gate_dbfs)
        )
        if -lost > best[0] or lost <= MOST_LOST:
            best = (-lost, share)
            write_finetuned(args.out, recipe, weights, facts={**facts, "share": share})
        if lost <= MOST_LOST:
            break
    return best[1]


def _measure(
    args: argparse.Namespace, data: "FinetuningData", calibration: Calibration | None
) -> dict[str, dict[str, "Change"]]:
    """Score before and after, each set with the contact threshold of its own set-up."""
    from tactophone_lab.evaluation.bootstrap import compare_models

    start = model_path(args.model)
    gate_dbfs = read_model(start).card.gate.threshold_dbfs
    parts: dict[str, tuple[Sequence[Recording], Callable[[Recording], str], float]] = {
        # By take, as a few new objects leave nothing else to draw: intervals hold for
        # these objects only.
        NEW: (
            data.held_out,
            lambda take: str(take.path),
            calibration.window_dbfs if calibration else gate_dbfs,
        ),
        GENERAL: (data.test, lambda take: take.surface, gate_dbfs),
    }
    return {
        name: compare_models(
            *(
                _predict(path, part, f"{name}, {when}", level)
                for path, when in ((start, "before"), (args.out, "after"))
            ),
            by=by,
        )
        for name, (part, by, level) in parts.items()
    }


def _predict(
    path: Path, recordings: Sequence[Recording], note: str, threshold_dbfs: float
) -> "list[TakePredictions]":
    from tactophone_lab.evaluation.predict import model_predictor

    model = read_model(path)
    gate = replace(model.card.gate, threshold_dbfs=threshold_dbfs)
    predict = model_predictor(replace(model, card=replace(model.card, gate=gate)))
    with output.tracked(recordings, note) as takes:
        return [predict(take) for take in takes]
