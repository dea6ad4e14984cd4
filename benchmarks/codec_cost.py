"""What the link's codec costs our own detector, by bandwidth and bitrate; prints a table.

python benchmarks/codec_cost.py DIR    (DIR: tactophone simulate dataset DIR --seconds 5 --takes long_medium,wiggle)
"""

import argparse
from pathlib import Path

from tactophone.benchmark.recipe_methods import judge_by
from tactophone.benchmark.result import scored
from tactophone.dataset import Fold, open_dataset, split
from tactophone.evaluation.metrics import measure
from tactophone.evaluation.predictions import TakePredictions, scores_of
from tactophone.link import Codec
from tactophone.training.features.feature_tracks import FeatureSpec
from tactophone.training.features.training_set import prepare
from tactophone.training.recipes import RECIPES

CODECS = (
    None,
    *(Codec("opus", packet_size=480, bandwidth=band, bitrate_bps=rate) for band, rate in (
        (4000, 64_000), (4000, 96_000), (8000, 64_000), (8000, 96_000), (8000, 128_000), (20_000, 128_000),
    )),
)  # fmt: skip

SHIPPED = tuple(Codec("opus", packet_size=480, bandwidth=band, bitrate_bps=96_000) for band in (4000, 8000))
"""What the model inside the package has heard besides the sound as it is."""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    folds = split(open_dataset(parser.parse_args().folder), "5-fold")
    print(
        "| codec | band | learnt through it: BA | AUC | rec1 | without: BA | AUC | rec1 | as shipped: BA | AUC | rec1 |"
    )
    print("|---|---|" + "--:|" * 9)
    for codec in CODECS:
        name = f"Opus, {codec.bitrate_bps // 1000} kbit/s" if codec else "PCM, 1.5 Mbit/s"
        band = f"{codec.bandwidth / 1000:g} kHz" if codec else "all"
        ways = ((codec, ()), (None, ()), (None, SHIPPED))
        cells = [cell for learnt, through in ways for cell in _scores(folds, learnt, through=through, heard=codec)]
        print(f"| {name} | {band} | {' | '.join(cells)} |", flush=True)


def _scores(
    folds: tuple[Fold, ...], learnt: Codec | None, *, through: tuple[Codec, ...], heard: Codec | None
) -> list[str]:
    judged: list[TakePredictions] = []
    for fold in folds:
        lesson = prepare(FeatureSpec(codec=learnt), fold.train, through=through)
        judge = judge_by(RECIPES["ours"].build(lesson).SerializeToString(), lesson, ear=FeatureSpec(codec=heard))
        judged += map(judge, fold.test)
    found = measure(scores_of(map(scored, judged), "two-class"))
    return [f"{found[name]:.3f}" for name in ("balanced_accuracy", "auc", "recall_at_1")]


if __name__ == "__main__":
    main()
