"""When is a change of surface reported under a finger that does not lift?

    python benchmarks/edges.py SET [--also SET ...] [--kin CSV] [--tip stylus]
    python benchmarks/edges.py SET --model NAME

SET is split into five folds, kin together; the recipe ``texture`` is trained on four of
them, and on the sets of ``--also``, and edges are joined from the touches of the fifth
(`evaluation.bumps_and_delays.join_edges`). With ``--model`` that model, which must not
have been trained on SET, is asked about edges joined from all of it. p50 and p95 are
over *all* edges on which the finger slides; one that is never reported counts as
infinite. A row of the first table is *as felt* where the evidence of the touch decides,
as in `feel`. Contact then begins at the *noise of the takes*, the louder floor of the
two that are joined, or at the *card's threshold*, which is the noise of all sessions;
or *all sound is contact*, as the finger does not lift. *Windows* decide over the noise
of the takes, each alone or as many in a row as the model's card says, to say what
evidence costs. The second table lists every edge that was never reported.
"""

import argparse
import math
import tempfile
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from cells import in_ms
from tactophone.core.recordings.values import Dataset, Recording, slides_over, tip_of
from tactophone.core.types import Touch
from tactophone.signal.perception.decision import Decision, DecisionRule
from tactophone.signal.perception.model_file import Model, read_model
from tactophone.signal.perception.models import model_path
from tactophone_lab.benchmark.methods import FEATURE_LATENCY
from tactophone_lab.datasets.open import open_dataset
from tactophone_lab.datasets.splits import split, with_kin
from tactophone_lab.evaluation.bumps_and_delays import (
    Delays,
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

SILENCE_DBFS = -120.0

WAYS = {
    "floor": "as felt: the evidence of the touch, over the noise of the takes",
    "model": "as felt, over the card's threshold",
    "touching": "as felt, all sound taken for contact",
    "windows": "windows, over the noise of the takes",
}
"""How an edge may be predicted: field of `Edge`, and what the tables call it."""


@dataclass(frozen=True, slots=True)
class Edge:
    """The predictions of an edge, by each threshold of contact, and by single
    windows."""

    model: TakePredictions
    floor: TakePredictions
    touching: TakePredictions
    windows: TakePredictions


def predict_folds(
    dataset: Dataset,
    also: list[Recording],
    options: TrainingOptions,
    folds: str,
    folder: Path,
) -> list[Edge]:
    """Join the edges of each held-out fold, and predict them by a model trained without
    that fold."""
    edges = []
    for fold in split(dataset, folds):
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


def describe(way: str, take: TakePredictions) -> str:
    """Return a row on what was predicted after an edge that was never reported."""
    after = take.recording.segments[2]
    here = take.time > after.start
    share = np.median(rough_score(take.probabilities[here], "two-class"))
    unknown, quiet = (
        take.probabilities[here, Touch.NONE].mean(),
        1 - take.contact[here].mean(),
    )
    return (
        f"| {way} | {take.recording.surface} | {after.label_name} | {share:.2f} | "
        f"{unknown:.2f} | {quiet:.2f} |"
    )


def print_edges(edges: Sequence[Edge], rule: DecisionRule) -> None:
    """Print when edges were reported, then those that never were."""
    columns = ["p50", "p95", "never reported", "p95 of those reported"]
    for label in (Touch.ROUGH, Touch.SMOOTH):
        columns.append(f"to {label.name.lower()}: p50, never")
    print(f"| | edges | {' | '.join(columns)} |")
    print(f"|---|--:|{'--:|' * len(columns)}")
    lost = []
    for field, way in WAYS.items():
        takes = [getattr(edge, field) for edge in edges]
        print(f"| {way} | {' | '.join(cells_of(takes, rule))} |")
        lost += [
            describe(way, take) for take in takes if delays_of([take], rule).missed
        ]
    if lost:
        print(
            "\n| never reported | edge | to | P(rough) after it, p50 | P(none), mean "
            "| share without contact |\n|---|---|---|--:|--:|--:|"
        )
        print("\n".join(lost))


def cells_of(takes: Sequence[TakePredictions], rule: DecisionRule) -> list[str]:
    """Return the cells of one way to predict edges."""
    found = delays_of(takes, rule)
    slowest = 1e3 * np.quantile(found.times, 0.95) if len(found.times) else math.nan
    cells = [
        str(len(takes)),
        in_ms(found.quantile_ms(0.5)),
        in_ms(found.quantile_ms(0.95)),
        str(found.missed),
        in_ms(slowest),
    ]
    for label in (Touch.ROUGH, Touch.SMOOTH):
        some = [take for take in takes if take.recording.segments[2].label is label]
        there = delays_of(some, rule)
        cells.append(f"{in_ms(there.quantile_ms(0.5))}, {there.missed} of {len(some)}")
    return cells


def delays_of(takes: Sequence[TakePredictions], rule: DecisionRule) -> Delays:
    return edge_delays(takes, rule, latency=FEATURE_LATENCY)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("dataset", type=Path, metavar="SET", help="takes with contact")
    parser.add_argument(
        "--also", type=Path, nargs="*", default=[], metavar="SET", help="trained on too"
    )
    parser.add_argument(
        "--kin", type=Path, metavar="CSV", help="which surfaces of SET are kin"
    )
    parser.add_argument(
        "--tip", default="", help="of the recipe (default: that of SET)"
    )
    parser.add_argument("--model", help="train none; ask this one")
    parser.add_argument(
        "--split", default="5-fold", help="of SET (default: %(default)s)"
    )
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
            edges = predict_folds(dataset, also, options, args.split, Path(folder))
        print_edges(edges, rule)


if __name__ == "__main__":
    main()
