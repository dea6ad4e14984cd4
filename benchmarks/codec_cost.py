"""Prints what the link's codec costs the texture detector, by bandwidth and bitrate.

python benchmarks/codec_cost.py DIR    (DIR: tactophone simulate dataset DIR --seconds 5 --takes long_medium,wiggle)
"""

import argparse
from pathlib import Path

from tactophone.benchmark import graph_predictor, in_true_contact, recipe_method
from tactophone.dataset import Fold, open_dataset, split
from tactophone.evaluation import TakePredictions, measure, scores_of
from tactophone.link import Codec
from tactophone.training import FeatureSpec, build_training_set

CODECS = (
    None,
    *(Codec("opus", packet_size=480, bandwidth=band, bitrate_bps=rate) for band, rate in (
        (4000, 64_000), (4000, 96_000), (8000, 64_000), (8000, 96_000), (8000, 128_000), (20_000, 128_000),
    )),
)  # fmt: skip

SHIPPED = tuple(Codec("opus", packet_size=480, bandwidth=band, bitrate_bps=96_000) for band in (4000, 8000))
"""Codecs through which the shipped model is trained, besides the sound as it is."""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    folds = split(open_dataset(parser.parse_args().folder), "5-fold")
    print(
        "| codec | band | trained through it: BA | AUC | rec1 | without: BA | AUC | rec1 "
        "| as shipped: BA | AUC | rec1 |"
    )
    print("|---|---|" + "--:|" * 9)
    for codec in CODECS:
        name = f"Opus, {codec.bitrate_bps // 1000} kbit/s" if codec else "PCM, 1.5 Mbit/s"
        band = f"{codec.bandwidth / 1000:g} kHz" if codec else "all"
        trainings = ((codec, ()), (None, ()), (None, SHIPPED))
        cells = [cell for trained, more in trainings for cell in _scores(folds, trained, codecs=more, tested=codec)]
        print(f"| {name} | {band} | {' | '.join(cells)} |", flush=True)


def _scores(
    folds: tuple[Fold, ...], trained: Codec | None, *, codecs: tuple[Codec, ...], tested: Codec | None
) -> list[str]:
    job = recipe_method("texture", channels=2).job
    takes: list[TakePredictions] = []
    for fold in folds:
        training_set = build_training_set(FeatureSpec(codec=trained), fold.train, codecs=codecs)
        graph = job.build(training_set).SerializeToString()
        predict = graph_predictor(graph, training_set, spec=FeatureSpec(codec=tested))
        takes += map(predict, fold.test)
    metrics = measure(scores_of(map(in_true_contact, takes), "two-class"))
    return [f"{metrics[name]:.3f}" for name in ("balanced_accuracy", "auc", "recall_at_1")]


if __name__ == "__main__":
    main()
