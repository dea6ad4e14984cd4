"""What `tactophone feel --tip stylus` renders of real kinds that its model was not trained on.

    python benchmarks/rendered_real.py [SIMULATED ...] [--by surface]     (needs TACTOPHONE_RECORDINGS)

For each kind of `lmt` (``lmt_kin.csv``; or each surface) a model is trained on the other kinds, core and extended, and
on SIMULATED sets of the stylus, as `make model` trains the shipped one; its takes then pass through the pipeline of
`feel`, with the gate's threshold from each take itself. Every run is a look at real scores: enter it in
docs/research/looks.md. *Right*: share of the time within 30 dB of the take's loudest that is rendered as its label.
"""

import argparse
import os
import tempfile
from collections import defaultdict
from dataclasses import replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tactophone.dataset.read import open_dataset
from tactophone.dataset.splits import kin_of, with_kin
from tactophone.dataset.values import Dataset, Recording
from tactophone.evaluation.events import decided_touches
from tactophone.evaluation.predict import model_predictor
from tactophone.perception.model_file import Model, read_model
from tactophone.training.recipes import RECIPES, TrainingOptions
from tactophone.training.tracks import FeatureSpec, extract_features
from tactophone.types import Touch

AUDIBLE_DB = 30.0

OPTIONS = TrainingOptions(channels=1, microphone="air", tip="stylus")


def train(recordings: list[Recording], dataset: Dataset, folder: Path) -> Model:
    """Train the recipe ``texture`` as the shipped model of the stylus."""
    path = folder / "stylus.onnx"
    RECIPES["texture"].with_options(OPTIONS).train(path, replace(dataset, recordings=tuple(recordings)))
    return read_model(path)


def rendered(model: Model, recording: Recording) -> NDArray[np.int8]:
    """Return what is rendered while the take is at most `AUDIBLE_DB` under its loudest."""
    take = model_predictor(model, own_floor=True)(recording)
    (track,) = extract_features([recording], FeatureSpec(channels=1, microphone="air"))
    audible = track.end[track.level_dbfs >= track.level_dbfs.max() - AUDIBLE_DB]
    # The newest prediction at the end of each audible window.
    newest = np.searchsorted(take.time, audible + 1e-6) - 1
    return np.asarray(decided_touches(take, model.card.decision)[newest])


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("simulated", type=Path, nargs="*")
    parser.add_argument("--by", choices=("kin", "surface"), default="kin")
    args = parser.parse_args()
    real = with_kin(
        open_dataset(Path(os.environ["TACTOPHONE_RECORDINGS"], "lmt")), Path(__file__).with_name("lmt_kin.csv")
    )
    real = real.where(lambda take: take.tier in ("core", "extended")).labelled()
    simulated = [take for folder in args.simulated for take in open_dataset(folder).recordings]
    group = kin_of if args.by == "kin" else (lambda take: take.surface)
    counts: dict[str, NDArray[np.int64]] = defaultdict(lambda: np.zeros(3, np.int64))
    with tempfile.TemporaryDirectory() as folder:
        for name in sorted({group(take) for take in real.recordings}):
            kept = [take for take in real.recordings if group(take) != name]
            model = train(kept + simulated, real, Path(folder))
            for take in real.recordings:
                if group(take) == name:
                    counts[take.surface] += np.bincount(rendered(model, take), minlength=3)
    print_table(real, counts)


def print_table(real: Dataset, counts: dict[str, NDArray[np.int64]]) -> None:
    """Print the shares of each surface, then of core and of all."""
    first = {take.surface: take for take in reversed(real.recordings)}
    print("| surface | label | right | nothing rendered |\n|---|---|--:|--:|")
    right = {name: count[first[name].label or 0] / count.sum() for name, count in counts.items()}
    gaps = {name: count[Touch.NONE] / count.sum() for name, count in counts.items()}
    for name in sorted(counts, key=lambda name: (first[name].tier, name)):
        print(f"| {name} | {Touch(first[name].label or 0).name.lower()} | {right[name]:.2f} | {gaps[name]:.3f} |")
    for tier in ("core", "core + extended"):
        names = [name for name in counts if first[name].tier in tier]
        rough = np.array([first[name].label is Touch.ROUGH for name in names])
        share, gap = np.array([right[name] for name in names]), np.mean([gaps[name] for name in names])
        balanced = (share[rough].mean() + share[~rough].mean()) / 2
        print(f"{tier}: right {share.mean():.3f}, balanced {balanced:.3f}, nothing rendered {gap:.3f}")


if __name__ == "__main__":
    main()
