"""``tactophone finetune``: improve a model on new objects, and show what that costs elsewhere."""

import argparse
import math
import tempfile
import time
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from rich.table import Table

from tactophone.cli._support import terminal
from tactophone.cli._support.dataset_options import add_filter, open_filtered
from tactophone.cli._support.ranges import SEED
from tactophone.dataset import Dataset, Recording, split
from tactophone.errors import DatasetError
from tactophone.perception import Calibration, WindowDetector, model_path, read_model
from tactophone.types import Detector

if TYPE_CHECKING:
    from tactophone.evaluation import Change, TakePredictions
    from tactophone.training import NetworkRecipe
    from tactophone.training.finetune import FinetuningData
    from tactophone.types import FloatArray

REPLAYED, VALIDATED, TESTED = 40, 12, 21
"""Most recordings used of the general set: with takes of 30 s, the whole verb takes under five minutes on two cores."""

MOST_LOST = 0.005
"""Largest loss of balanced accuracy on the few validation surfaces, so that others lose at most 0.02."""

HEADINGS = {"balanced_accuracy": "balanced accuracy", "false_positive_rate": "smooth as rough"}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the verb's arguments."""
    parser.add_argument("model", metavar="MODEL", help="model to start from: a file, or the name of a shipped one")
    parser.add_argument(
        "new", type=Path, metavar="DIR", help="recordings of two or more new objects, two takes or more"
    )
    parser.add_argument(
        "--general", type=Path, required=True, metavar="DIR", help="a general data set, to replay and to test with"
    )
    parser.add_argument("--out", type=Path, default=Path("finetuned.onnx"), metavar="FILE", help="model file to write")
    parser.add_argument(
        "--strategy", choices=("blend", "fine-tuned"), default="blend",
        help="train on both and mix with the old parameters, or the paper's own fine-tuning",
    )  # fmt: skip
    parser.add_argument("--calibration", type=Path, metavar="FILE", help="contact threshold of the new recordings")
    parser.add_argument("--seed", type=SEED, default=0, metavar="N", help="of everything random, %(type)s")
    parser.add_argument("--json", action="store_true", help="print JSON instead of a table")
    add_filter(parser)


def run(args: argparse.Namespace) -> int:
    """Fine-tune, measure before and after, write the model."""
    from tactophone.training import finetune

    began = time.monotonic()
    data = _data(args)
    calibration = Calibration.read(args.calibration) if args.calibration else None
    recipe = finetune.finetuning_recipe(model_path(args.model), args.strategy, seed=args.seed, calibration=calibration)
    with terminal.progress("training") as update:
        trained = finetune.train_on_both(
            recipe, data,
            reading=lambda done, count: update(completed=done, total=count, note="reading"),
            report=lambda at: update(completed=at.steps, total=at.total, note=f"loss {at.loss:.3f}"),
        )  # fmt: skip
    share = _choose(args, recipe, trained, data)
    changes = _measure(args, data, calibration)
    _print(args, changes, share=share, seconds=time.monotonic() - began)
    return 0


def _data(args: argparse.Namespace) -> "FinetuningData":
    from tactophone.training.finetune import FinetuningData, hold_out, thinned

    channels = read_model(model_path(args.model)).card.channels
    new, held_out = hold_out(open_filtered(args.new, args.filter, channels=channels))
    general = open_filtered(args.general, None, channels=channels)
    rest, test = _split(general)
    replay, validation = _split(general.where(lambda recording: recording in rest))
    return FinetuningData(
        new, held_out, thinned(replay, REPLAYED), thinned(validation, VALIDATED), thinned(test, TESTED)
    )


def _split(dataset: Dataset) -> tuple[Sequence[Recording], Sequence[Recording]]:
    """Split surfaces: as the data set itself says, or three quarters and one quarter."""
    try:
        fold = split(dataset, "predefined")[0]
    except DatasetError:
        fold = split(dataset, f"{min(4, len(dataset.surfaces))}-fold")[0]
    return fold.train, fold.test


def _choose(
    args: argparse.Namespace, recipe: "NetworkRecipe", trained: "dict[str, FloatArray]", data: "FinetuningData"
) -> float:
    """Write the mixture with the largest share of the new without losing much on the validation surfaces."""
    from tactophone.evaluation import accuracy_of
    from tactophone.training.finetune import mixtures, write_finetuned

    start = model_path(args.model)
    facts: dict[str, object] = {
        "strategy": args.strategy,
        "new": sorted({recording.surface for recording in data.new}),
        "takes": len(data.new),
    }
    gate_dbfs = read_model(start).card.gate.threshold_dbfs
    before = accuracy_of(_predict(start, data.validation, "choosing", gate_dbfs))
    best: tuple[float, float] = (-1.0, 0.0)
    with tempfile.TemporaryDirectory() as folder:
        for share, weights in mixtures(start, trained, args.strategy):
            path = Path(folder) / "mixture.onnx"
            write_finetuned(path, recipe, weights, facts=facts)
            lost = before - accuracy_of(_predict(path, data.validation, f"choosing, {share:.0%} new", gate_dbfs))
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
    from tactophone.evaluation import by_surface, by_take, compare_models

    start = model_path(args.model)
    gate_dbfs = read_model(start).card.gate.threshold_dbfs
    parts = {
        "new objects, held-out takes": (data.held_out, by_take, calibration.window_dbfs if calibration else gate_dbfs),
        "general test set": (data.test, by_surface, gate_dbfs),
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


def _predict(path: Path, recordings: Sequence[Recording], note: str, threshold_dbfs: float) -> "list[TakePredictions]":
    from tactophone.evaluation import streaming_predictor

    model = read_model(path)

    def open_detector(rate: int) -> Detector:
        detector = WindowDetector(model, sample_rate=rate)
        detector.threshold.dbfs = threshold_dbfs
        return detector

    predict = streaming_predictor(open_detector, channels=model.card.channels)
    with terminal.tracked(recordings, note) as takes:
        return [predict(take) for take in takes]


def _print(args: argparse.Namespace, changes: dict[str, dict[str, "Change"]], *, share: float, seconds: float) -> None:
    if args.json:
        scores = {name: {key: change.as_json() for key, change in part.items()} for name, part in changes.items()}
        terminal.print_json({**scores, "share": share, "seconds": seconds, "file": str(args.out)})
        return
    table = Table("", "before", "after", "change, points", box=None)
    for name, part in changes.items():
        table.add_row(f"[bold]{name}[/]")
        for key, change in part.items():
            if math.isnan(change.before.value):
                table.add_row(f"  {HEADINGS[key]}", "none smooth", "", "")
                continue
            points = [100 * value for value in (change.difference.value, change.difference.low, change.difference.high)]
            text = f"{points[0]:+.1f} ({points[1]:+.1f} to {points[2]:+.1f})"
            table.add_row(f"  {HEADINGS[key]}", str(change.before), str(change.after), text)
    terminal.out().print(table)
    terminal.out().print(f"share of the new parameters: {share:.0%}; {seconds:.0f} s; intervals: 90 %")
    new, elsewhere = (
        changes[name]["balanced_accuracy"] for name in ("new objects, held-out takes", "general test set")
    )
    if new.after.value < min(1.0, new.before.value + 1e-9) or elsewhere.difference.value < -0.02:
        terminal.log().print(
            "beware: not better on the new objects, or over 2 points worse elsewhere; keep the old model"
        )
    terminal.out().print(args.out, soft_wrap=True)
