"""How the demonstration is rendered, over many seeds: rough and smooth stone, false
bumps, dips, gaps; simulated sound.

    python benchmarks/demo_scores.py [--seeds 30] [--first 0]

The strokes and the competition's noise are as in `tactophone demo`; they go through
the pipeline without the network.
"""

import argparse
from typing import get_args

import numpy as np

from tactophone.core.tips import DEFAULT_TIP, TIP_NAMES
from tactophone.core.types import ContactRule, Touch
from tactophone.signal.perception.decision import count_dips
from tactophone.signal.pipeline import open_pipeline
from tactophone_lab.simulation.demonstration import demonstration

BRIDGE = 0.03
"""Seconds; bumps closer than this are perceived as one."""

ROWS = {
    "rough rendered rough": ".3f",
    "smooth rendered rough": ".3f",
    "silent in contact": ".3f",
    "false bumps in 10 s of smooth": ".1f",
    "dips in a minute of rough": ".1f",
}
"""What is scored, and how it is printed: shares of contact, then counts."""


def score(
    seed: int, *, tip: str, model: str, contact: ContactRule
) -> tuple[float, float, float, float, float]:
    """Return shares of contact (rough as rough, smooth as rough, silent), false bumps
    in 10 s, dips in a minute."""
    finger = demonstration(seed, tip=tip)
    labels = [each.label for each in finger.scene.objects]
    pipeline = open_pipeline(
        model,
        sample_rate=finger.sample_rate,
        channels=finger.channels,
        tip=tip,
        contact=contact,
    )
    predictions, truth = [], []
    with finger:
        for block in finger:
            predictions += pipeline.push(block).predictions
            truth.append(finger.truth.object_index)
    index = np.concatenate(truth)
    times = np.array([each.end for each in predictions])
    touches = np.array([each.touch for each in predictions])
    place = index[np.minimum((times * finger.sample_rate).astype(int), len(index) - 1)]
    on = {
        label: np.isin(place, [n for n, each in enumerate(labels) if each is label])
        for label in labels
    }
    rough, smooth = on[Touch.ROUGH], on[Touch.SMOOTH]
    bumps = times[(touches == Touch.ROUGH) & smooth]
    count = int(len(bumps) > 0) + int((np.diff(bumps) > BRIDGE).sum())
    hop = float(np.median(np.diff(times)))
    return (
        float((touches[rough] == Touch.ROUGH).mean()),
        float((touches[smooth] == Touch.ROUGH).mean()),
        float((touches[rough | smooth] == Touch.NONE).mean()),
        10 * count / (hop * smooth.sum()),
        60 * count_dips(touches == Touch.ROUGH, rough) / (hop * rough.sum()),
    )


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--seeds", type=int, default=30, help="how many (default: %(default)s)"
    )
    parser.add_argument(
        "--first",
        type=int,
        default=0,
        help="first seed; choices were made on 100 to 300",
    )
    parser.add_argument("--tip", choices=TIP_NAMES, default=DEFAULT_TIP)
    parser.add_argument("--model", default="", help="default: the tip's own")
    parser.add_argument(
        "--contact",
        choices=get_args(ContactRule),
        default="bands",
        help="rule for contact (default: %(default)s)",
    )
    args = parser.parse_args()
    seeds = range(args.first, args.first + args.seeds)
    scores = np.array(
        [
            score(seed, tip=args.tip, model=args.model, contact=args.contact)
            for seed in seeds
        ]
    )
    worst = [scores[:, 0].min(), *scores[:, 1:].max(axis=0)]
    print(f"| | seeds {seeds[0]} to {seeds[-1]}: mean | worst |\n|---|--:|--:|")
    for (name, form), mean, extreme in zip(
        ROWS.items(), scores.mean(axis=0), worst, strict=True
    ):
        print(f"| {name} | {mean:{form}} | {extreme:{form}} |")


if __name__ == "__main__":
    main()
