"""When is a change of surface reported under a finger that does not lift? Lists every
edge that never is.

    python benchmarks/edges.py SET [--also SET ...] [--kin CSV] [--tip stylus]
    python benchmarks/edges.py SET --model NAME

SET is split into five folds, kin together; the recipe ``texture`` is trained on four of
them, and on the sets of ``--also``, and edges are joined from the touches of the fifth
(`evaluation.bumps_and_delays.join_edges`). With ``--model`` that model, which must not
have been trained on SET, is asked about edges joined from all of it. p50 and p95 are
over *all* edges on which the finger slides; one that is never reported counts as
infinite. What counts is what is felt: the evidence of the touch decides, as in `feel`.
*Model*: contact begins at the threshold of the model's card, which is the noise of all
sessions. *Floor*: at the louder noise floor of the two takes that are joined.
*Touching*: all sound is contact, as the finger does not lift. *Windows*: windows decide
over the floor, each alone or as many in a row as the model's card says, to say what
evidence costs.
"""

import argparse
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from tactophone.core.recordings.values import Dataset, Recording, slides_over, tip_of
from tactophone.core.types import SURFACE_LABELS, Touch
from tactophone.signal.perception.decision import Decision, DecisionRule
from tactophone.signal.perception.model_file import Model, read_model
from tactophone.signal.perception.models import model_path
from tactophone_lab.benchmark.methods import FEATURE_LATENCY
from tactophone_lab.datasets.open import open_dataset
from tactophone_lab.datasets.splits import split, with_kin
from tactophone_lab.evaluation.bumps_and_delays import (
    edge_delays,
    edge_threshold_dbfs,
    join_edges,
)
from tactophone_lab.evaluation.metrics import rough_score
from tactophone_lab.evaluation.predict import (
    TakePredictions,
    model_predictor,
    recording_predictor,
)
from tactophone_lab.training.recipe_options import TrainingOptions
from tactophone_lab.training.recipes import RECIPES, configure

FOLDS = "5-fold"

SILENCE_DBFS = -120.0


@dataclass(frozen=True, slots=True)
class Edge:
    """The predictions of an edge, by each threshold of contact, and by single
    windows."""

    model: TakePredictions
    floor: TakePredictions
    touching: TakePredictions
    windows: TakePredictions


def predict_folds(
    dataset: Dataset, also: list[Recording], options: TrainingOptions, folder: Path
) -> list[Edge]:
    """Join the edges of each held-out fold, and predict them by a model trained without
    that fold."""
    edges = []
    for fold in split(dataset, FOLDS):
        path = folder / "fold.onnx"
        recordings = (*fold.train, *also)
        configure("texture", options).train(
            path, replace(dataset, recordings=recordings)
        )
        edges += predict_edges(fold.test, read_model(path), folder)
    return edges


def predict_edges(
    recordings: Sequence[Recording], model: Model, folder: Path
) -> list[Edge]:
    """Join edges from recordings, and predict those on which the finger slides."""
    edges = []
    for take in join_edges(recordings, folder):
        if slides_over(take, take.segments[2].start):
            floor = edge_threshold_dbfs(take, model.card.gate.rule)
            felt = (
                recording_predictor(model, threshold_dbfs=each)(take)
                for each in (model.card.gate.threshold_dbfs, floor, SILENCE_DBFS)
            )
            gate = replace(model.card.gate, threshold_dbfs=floor)
            windows = replace(model, card=replace(model.card, gate=gate))
            alone = by_windows(model_predictor(windows)(take), model.card.decision)
            edges.append(Edge(*felt, alone))
    return edges


def by_windows(take: TakePredictions, rule: DecisionRule) -> TakePredictions:
    """Return the take as each window alone would be rendered, without the evidence of
    those before it."""
    decision = Decision(rule)
    touches = [
        decision.decide((none, smooth, rough), contact=contact)[0]
        for (none, smooth, rough), contact in zip(
            take.probabilities.astype(float).tolist(),
            take.contact.tolist(),
            strict=True,
        )
    ]
    return replace(take, touch=np.array(touches, np.int8))


def describe(take: TakePredictions) -> str:
    """Return a row on what was predicted after an edge that was never reported."""
    after = take.recording.segments[2]
    here = take.time > after.start
    share = np.median(rough_score(take.probabilities[here], "two-class"))
    unknown, quiet = (
        take.probabilities[here, Touch.NONE].mean(),
        1 - take.contact[here].mean(),
    )
    return (
        f"| {take.recording.surface} | {after.label_name} | {share:.2f} | "
        f"{unknown:.2f} | {quiet:.2f} |"
    )


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("dataset", type=Path)
    parser.add_argument("--also", type=Path, nargs="*", default=[])
    parser.add_argument("--kin", type=Path)
    parser.add_argument("--tip", default="")
    parser.add_argument("--model", help="train none; ask this one")
    args = parser.parse_args()
    dataset = open_dataset(args.dataset).labelled()
    if args.kin:
        dataset = with_kin(dataset, args.kin).where(
            lambda take: take.tier in ("core", "extended")
        )
    also = [
        take
        for folder in args.also
        for take in open_dataset(folder).labelled().recordings
    ]
    channels = min(len(take.channels) for take in dataset.recordings)
    options = TrainingOptions(
        channels=channels,
        microphone="air" if channels == 1 else "contact",
        tip=args.tip,
    )
    rule = (
        RECIPES["texture"].response_for(args.tip or tip_of(dataset.recordings)).decision
    )
    with tempfile.TemporaryDirectory() as folder:
        if args.model:
            model = read_model(model_path(args.model))
            edges = predict_edges(dataset.recordings, model, Path(folder))
        else:
            edges = predict_folds(dataset, also, options, Path(folder))
        for name in ("model", "floor", "touching", "windows"):
            takes = [getattr(edge, name) for edge in edges]
            delays = edge_delays(takes, rule, latency=FEATURE_LATENCY)
            print(
                f"{name}: {len(edges)} edges, p50 {delays.quantile_ms(0.5):.0f} ms, "
                f"p95 {delays.quantile_ms(0.95):.0f} "
                f"ms, never {delays.missed}; p95 of those reported "
                f"{1e3 * np.quantile(delays.times, 0.95):.0f} ms"
            )
            for label in SURFACE_LABELS:
                some = [
                    take for take in takes if take.recording.segments[2].label is label
                ]
                delays = edge_delays(some, rule, latency=FEATURE_LATENCY)
                print(
                    f"to {label.name.lower()}: {len(some)} edges, p50 "
                    f"{delays.quantile_ms(0.5):.0f} ms, never {delays.missed}"
                )
            print(
                "\n| never reported | to | P(rough), p50 | unknown | without contact "
                "|\n|---|---|--:|--:|--:|"
            )
            lost = [
                take
                for take in takes
                if edge_delays([take], rule, latency=FEATURE_LATENCY).missed
            ]
            print("\n".join(map(describe, lost)), end="\n\n")


if __name__ == "__main__":
    main()
