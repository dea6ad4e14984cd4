"""Whether the pad hears an order among rough surfaces that it never met; SIMULATED.

    python benchmarks/order.py [--kinds 32] [--seed 0]

Rough kinds with grains of 50 um to 2 mm and an Ra of 1 to 100 um are drawn, rendered
under the pad, and described by the features of `texture`. A ridge regression to log Ra
learns from every other kind and ranks the rest. Printed are Spearman's correlation on
the kinds kept out, with a 90 % interval over them, and the share of pairs in the right
order whose Ra differ by a factor of 2 or more; beside both, the same for the logit of
the shipped classifier.
"""

import argparse
import tempfile
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from scipy.stats import spearmanr

from tactophone.core.types import Touch
from tactophone_lab.datasets.open import open_dataset
from tactophone_lab.evaluation.metrics import log_odds
from tactophone_lab.evaluation.predict import recording_predictor
from tactophone_lab.simulation.catalogue import SimulatedObject, find
from tactophone_lab.simulation.render import (
    RenderOptions,
    plan_dataset,
    render_dataset,
    write_manifest,
)
from tactophone_lab.simulation.surface import Grains, Surface
from tactophone_lab.simulation.takes import TAKES
from tactophone_lab.training.baselines import FeatureRecipe
from tactophone_lab.training.recipes import configure
from tactophone_lab.training.tracks import extract_features, noise_level

Floats = NDArray[np.float64]


def draw_kind(number: int, rng: np.random.Generator) -> SimulatedObject:
    """Draw a rough kind: a stone of the catalogue with other heights."""
    spacing = float(np.exp(rng.uniform(np.log(50e-6), np.log(2e-3))))
    # Grains are at most half as high as they are apart; steeper ones would fall over.
    height = float(np.exp(rng.uniform(np.log(2.5e-6), np.log(800e-6))))
    height = min(height, 0.5 * spacing)
    shape = Surface(
        f"kind {number}",
        1000 + number,
        rms_height=0.2 * height,
        rolloff=max(spacing, 1e-4),
        fine_height=1e-6,
        grains=Grains(
            spacing,
            height,
            spread=float(rng.uniform(0.2, 0.6)),
            filling=float(rng.uniform(0.7, 1)),
        ),
    )
    stone = find(
        str(
            rng.choice(
                ["lava stone", "sandstone", "brick", "concrete paver", "flamed granite"]
            )
        )
    )
    return replace(
        stone,
        number=100 + number,
        name=f"kind {number}",
        surface=shape,
        label=Touch.ROUGH,
    )


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--kinds", type=int, default=32, help="that are drawn (default: 32)"
    )
    parser.add_argument("--seed", type=int, default=0, help="default: 0")
    args = parser.parse_args()
    rng = np.random.default_rng(args.seed)
    kinds = [draw_kind(number, rng) for number in range(args.kinds)]
    takes = [
        take for take in TAKES if take.name in ("long_medium", "short_light", "wiggle")
    ]
    recipe = configure("texture")
    assert isinstance(recipe, FeatureRecipe)
    predict = recording_predictor("texture")
    with tempfile.TemporaryDirectory() as folder:
        jobs = plan_dataset(
            kinds, RenderOptions(6.0, args.seed, gain_db=-12.0), takes=takes
        )
        list(render_dataset(Path(folder), jobs))
        write_manifest(Path(folder), jobs)
        recordings = open_dataset(folder).recordings
        tracks = extract_features(recordings, recipe.spec)
        rows: dict[str, list[Floats]] = {}
        logits: dict[str, list[float]] = {}
        heights = {
            each.recording.surface: float(
                np.log10(float(each.recording.known("ra_um")))
            )
            for each in tracks
        }
        for recording, track in zip(recordings, tracks, strict=True):
            loud = track.touching() & track.loud(noise_level([track]))
            each = track.description[loud].reshape(int(loud.sum()), -1)
            rows.setdefault(recording.surface, []).append(
                np.concatenate((each.mean(axis=0), each.std(axis=0)))
            )
            found = predict(recording)
            odds = log_odds(found.probabilities[found.contact])
            logits.setdefault(recording.surface, []).append(float(odds.mean()))
    names = sorted(rows, key=lambda name: heights[name])
    height = np.array([heights[name] for name in names])
    span = f"Ra {10 ** height[0]:.1f} to {10 ** height[-1]:.0f} um"
    print(f"{len(names)} SIMULATED rough kinds, {span}, every other kept out\n")
    print(
        "| ranked by | Spearman with Ra | 90 % over kinds | in order, of pairs whose "
        "Ra differ by 2 | such pairs |\n|---|--:|--:|--:|--:|"
    )
    out = np.arange(1, len(names), 2)
    for words, score in (
        ("regression to log Ra", regress(rows, names, height)),
        (
            "logit of the classifier",
            np.array([np.mean(logits[name]) for name in names]),
        ),
    ):
        print_order(words, score[out], height[out])


def regress(rows: dict[str, list[Floats]], names: list[str], height: Floats) -> Floats:
    """Return the height of each kind as predicted by a regression on the even ones,
    mean over takes."""
    from sklearn.linear_model import RidgeCV
    from sklearn.pipeline import make_pipeline
    from sklearn.preprocessing import StandardScaler

    learnt = range(0, len(names), 2)
    examples = np.concatenate([rows[names[k]] for k in learnt])
    target = np.repeat(height[list(learnt)], [len(rows[names[k]]) for k in learnt])
    model = make_pipeline(StandardScaler(), RidgeCV(np.logspace(0, 4, 9))).fit(
        examples, target
    )
    return np.array([model.predict(np.array(rows[name])).mean() for name in names])


def print_order(words: str, score: Floats, height: Floats) -> None:
    rng = np.random.default_rng(0)
    drawn = [rng.integers(len(score), size=len(score)) for _ in range(1000)]
    low, high = np.nanpercentile(
        [spearmanr(score[each], height[each]).statistic for each in drawn], [5, 95]
    )
    first, second = np.nonzero(height[:, None] - height[None] >= np.log10(2))
    right = (score[first] > score[second]).mean()
    print(
        f"| {words} | {spearmanr(score, height).statistic:.2f} | {low:.2f} to "
        f"{high:.2f} | {right:.2f} | {len(first)} |"
    )


if __name__ == "__main__":
    main()
