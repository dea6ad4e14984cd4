"""Does `setup` make worse what fits, and better what does not?  Prints the table of docs/research/set-up.md.

    python benchmarks/set_up.py [--takes 2] [--channels NAME ...]    (needs TACTOPHONE_RECORDINGS)

A set-up is one rough and one smooth surface of real sound (`lmt`), so many takes of 4.8 s each, as they are or through
one channel of `distortions`. All 72 pairs are tried. Each other kind is scored, through the same channel, by a linear
detector of the recipe ``texture`` that was trained neither on this kind nor on those of the pair, and by what
`fit_set_up` makes of it. A pair's score is balanced over the surfaces scored, and counts windows in contact.
"""

import argparse
import os
import tempfile
from collections import defaultdict
from dataclasses import dataclass, replace
from functools import cache
from itertools import product
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from distortions import DISTORTIONS, distorted
from tactophone.core.types import FloatArray
from tactophone.lab.dataset.read import open_dataset
from tactophone.lab.dataset.splits import kin_of, with_kin
from tactophone.lab.dataset.values import Recording
from tactophone.lab.training.linear import fit_classifier
from tactophone.lab.training.recipes import RECIPES
from tactophone.lab.training.sets import MOST_WINDOWS, Examples
from tactophone.lab.training.setup import ObjectSound, fit_set_up
from tactophone.lab.training.tracks import FeatureSpec, FeatureTrack, RunningMoments, extract_features
from tactophone.signal.perception.noise_floor import measure_floor

SCORED = 4
"""Takes of a surface that are scored."""

AS_IT_IS = "as it is"

RECIPE = RECIPES["texture"]
SPEC = FeatureSpec(
    channels=1, microphone="air", change_detection=False, unevenness=True, memory=RECIPE.response_for("stylus").memory
)


@dataclass(frozen=True, slots=True, eq=False)
class Heard:
    """A take: where it is from, its description summed, and its running statistics in contact."""

    recording: Recording
    sums: NDArray[np.float64]
    count: int
    statistics: RunningMoments
    present: NDArray[np.bool_]

    def features(self, prior: NDArray[np.float64], every: int = 1, first: int = 0) -> FloatArray:
        moments, weight = self.statistics.moments[:, first::every], self.statistics.prior_weight[first::every]
        return RunningMoments(moments, weight).features(prior, self.present[first::every])


def hear(tracks: list[FeatureTrack], contact: list[NDArray[np.bool_]]) -> list[Heard]:
    """Run the statistics over takes."""
    from tactophone.lab.training.features import run_statistics

    metric = np.zeros((1, SPEC.values, SPEC.values))
    descriptions = [track.description for track in tracks]
    found = []
    for track, touching, states in zip(
        tracks, contact, run_statistics(descriptions, contact, metric, fading=SPEC.fading), strict=True
    ):
        moments = np.moveaxis(states["running"].reshape(-1, 2, 1, SPEC.values), 1, 0)[:, touching].astype(np.float32)
        own = RunningMoments(moments, 1 - states["evidence"][touching, 0])
        wide = track.description.astype(np.float64)
        sums = np.stack((wide.sum(axis=0), np.square(wide).sum(axis=0)))
        found.append(Heard(track.recording, sums, len(wide), own, track.present[touching]))
    return found


def in_contact(recording: Recording, track: FeatureTrack) -> NDArray[np.bool_]:
    """Return where a take is over its own noise floor."""
    block = recording.read(channels=1, single="air")
    floor = measure_floor([block], sample_rate=block.sample_rate, rule="banded")
    return np.asarray(track.level_dbfs >= floor.threshold_dbfs)


class Detectors:
    """Linear detectors without some kinds, trained once each."""

    def __init__(self, takes: list[Recording]) -> None:
        self._heard: list[Heard] = []
        for number in range(1 + RECIPE.augmentation.copies if RECIPE.augmentation else 1):
            copy = replace(SPEC, augmentation=RECIPE.augmentation, copy=(0, number)) if number else SPEC
            tracks = extract_features(takes, copy)
            self._heard += hear(tracks, [np.ones(len(track.end), bool) for track in tracks])
        self.without = cache(self._without)

    def _without(self, kinds: frozenset[str]) -> tuple[NDArray[np.float64], NDArray[np.float64], float]:
        """Train; return the prior, the weights of features and the bias."""
        kept = [take for take in self._heard if kin_of(take.recording) not in kinds]
        total = sum(take.count for take in kept)
        prior = np.sum([take.sums for take in kept], axis=0) / total
        every, at = -(-total // MOST_WINDOWS), 0
        rows, rough, surface, names = [], [], [], sorted({kin_of(take.recording) for take in kept})
        for take in kept:
            rows.append(take.features(prior, every, -at % every))
            rough += [take.recording.rough] * len(rows[-1])
            surface += [names.index(kin_of(take.recording))] * len(rows[-1])
            at += take.count
        examples = Examples(np.concatenate(rows), np.array(rough), np.array(surface))
        fitted = fit_classifier(examples, channels=1, tip="stylus")
        weights = fitted.weights[0] / fitted.scale
        return prior, weights, float(fitted.biases[0] - fitted.centre @ weights)


def score(detectors: Detectors, takes: list[Heard], fitted: int) -> tuple[list[float], list[float], float]:
    """Return the balanced share that is right before and after, of each pair, and how often the boundary changes."""
    surfaces: dict[str, list[Heard]] = defaultdict(list)
    for take in takes:
        surfaces[take.recording.surface].append(take)
    first = {name: own[0].recording for name, own in surfaces.items()}
    kinds = sorted({kin_of(each) for each in first.values()})

    @cache
    def sound(without: frozenset[str], name: str, count: int) -> ObjectSound:
        prior, weights, bias = detectors.without(without)
        features = np.concatenate([take.features(prior) for take in surfaces[name][:count]])
        return ObjectSound(name, first[name].rough, features, features @ weights + bias)

    before, after, changed = [], [], []
    for pair in product(*([name for name in first if first[name].rough is label] for label in (False, True))):
        shares: dict[bool, list[tuple[float, float]]] = {False: [], True: []}
        own = {kin_of(first[name]) for name in pair}
        for kind in kinds:
            if kind in own:
                continue
            without = frozenset(own | {kind})
            found = fit_set_up([sound(without, name, fitted) for name in pair], channels=1, tip="stylus")
            changed.append(not found.keeps)
            for name in (name for name in first if kin_of(first[name]) == kind):
                each = sound(without, name, SCORED)
                logits = each.logit, each.logit if found.keeps else found.correction.logit(each)
                old, new = (float(np.mean((logit > 0) == each.rough)) for logit in logits)
                shares[each.rough].append((old, new))
        old, new = np.mean([np.mean(own, axis=0) for own in shares.values()], axis=0)
        before.append(float(old))
        after.append(float(new))
    return before, after, float(np.mean(changed))


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--takes", type=int, default=2)
    parser.add_argument("--channels", nargs="*", default=[AS_IT_IS, *DISTORTIONS])
    args = parser.parse_args()
    folder = Path(os.environ["TACTOPHONE_RECORDINGS"], "lmt")
    real = with_kin(open_dataset(folder), Path(__file__).with_name("lmt_kin.csv"))
    takes = list(real.where(lambda take: take.tier in ("core", "extended")).labelled().recordings)
    detectors = Detectors(takes)
    tried = [take for take in takes if int(take.take or 0) <= SCORED]
    print("| channel | before | `setup` | changed | better by 0.01 | worse by 0.01 | worst |")
    print("|---|--:|--:|--:|--:|--:|--:|")
    differences: list[float] = []
    with tempfile.TemporaryDirectory() as made:
        for name in args.channels:
            heard = tried if name == AS_IT_IS else [distorted(take, name, Path(made)) for take in tried]
            tracks = extract_features(heard, SPEC)
            contact = [in_contact(take, track) for take, track in zip(heard, tracks, strict=True)]
            before, after, changed = score(detectors, hear(tracks, contact), args.takes)
            gain = np.subtract(after, before)
            differences += [] if name == AS_IT_IS else list(gain)
            cells = f"{np.median(before):.3f} | {np.median(after):.3f} | {changed:.2f}"
            ends = f"{np.mean(gain > 0.01):.2f} | {np.mean(gain < -0.01):.2f} | {gain.min():+.3f}"
            print(f"| {name} | {cells} | {ends} |", flush=True)
    if differences:
        gain = np.array(differences)
        shares = ", ".join(f"{np.mean(gain < -worse):.3f} worse by {worse}" for worse in (0.01, 0.05))
        print(f"\nof all distorted pairs: mean {gain.mean():+.3f}, median {np.median(gain):+.3f}; {shares}")


if __name__ == "__main__":
    main()
