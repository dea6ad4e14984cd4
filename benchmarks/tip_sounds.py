"""What touches of soft and of hard tips sound like: fits it, or scores how often a wrong tip is noticed.

    python benchmarks/tip_sounds.py FOLDER ... --out src/tactophone/perception/models/tips.npz
    python benchmarks/tip_sounds.py FOLDER ... [--seconds 10]

A run is a session of a FOLDER that `tactophone simulate dataset` wrote, its takes one after another. With
TACTOPHONE_RECORDINGS, `lmt` is a stylus: the odd groups of materials are fitted to, and the even ones scored; a run is
three takes of a surface. Scores count a run as noticed within ``--seconds`` of its sound, silences included, and as a
false alarm within all of it.
"""

import argparse
import os
from collections import defaultdict
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tactophone.dataset.read import open_dataset
from tactophone.dataset.values import Recording
from tactophone.perception.fit import HARD, SOFT, FitCheck, Misfit
from tactophone.perception.models import TIP_MODELS, open_detector
from tactophone.types import AudioBlock

RIDGE_DB = 1.2
"""Standard deviation that is added to every value, for what the sets do not vary; chosen in folds by kin."""

BLOCK = 4096

Floats = NDArray[np.float64]
Run = tuple[str, list[Recording]]
Verdicts = list[tuple[float, str]]


class Recorder(FitCheck):
    """Keeps the description at each verdict."""

    def reset(self) -> None:
        super().reset()
        self.found: list[Floats] = []

    def _judge(self, channels: int) -> Misfit | None:
        if self._heard().any():
            self.found.append(self.description())
        return None


def runs_of(folder: Path) -> list[Run]:
    """Return the tip and the takes of each run."""
    groups: dict[tuple[str, str], list[Recording]] = defaultdict(list)
    for take in sorted(open_dataset(folder).recordings, key=lambda take: take.path.name):
        groups[take.surface, take.session].append(take)
    if folder.name != "lmt":
        return [(takes[0].known("tip"), takes) for takes in groups.values()]
    return [("lmt", takes[first : first + 3]) for takes in groups.values() for first in range(0, len(takes) - 2, 3)]


def blocks(takes: list[Recording], channel: int | None) -> list[AudioBlock]:
    sound = np.concatenate([take.read().samples for take in takes])
    if channel is not None:
        sound = sound[:, [min(channel, sound.shape[1] - 1)]]
    rate = takes[0].read().sample_rate
    return [AudioBlock(sound[start : start + BLOCK], rate, start) for start in range(0, len(sound), BLOCK)]


def describe(run: Run, model: str, channel: int | None) -> Floats:
    """Return the descriptions of a run, ``(verdicts, values)``, with one channel or both."""
    sound = blocks(run[1], channel)
    detector = open_detector(model, sample_rate=sound[0].sample_rate, follow_floor=True)
    recorder = detector.detector.fit = Recorder(model, detector.detector.card.sample_rate, air=model == "stylus")
    for block in sound:
        detector.push(block)
    return np.array(recorder.found)


def notices(run: Run, tip: str) -> Verdicts:
    """Return when, in s, and by which code something is noticed under a tip's model."""
    sound = blocks(run[1], None)
    detector = open_detector(TIP_MODELS[tip], sample_rate=sound[0].sample_rate, follow_floor=True)
    found: Verdicts = []
    for block in sound:
        detector.push(block)
        if detector.misfit:
            found.append((block.end / block.sample_rate, detector.misfit.code))
    return found


def described(run: Run) -> list[tuple[str, Floats]]:
    """Return the descriptions for both microphones, for one of a soft tip's model, and for one of a hard one's."""
    tip, found = run[0], []
    if tip != "lmt":
        found.append(("both", describe(run, "texture", None)))
    found.append(("contact", describe(run, "texture", 0 if tip in SOFT else 1)))
    found.append(("air", describe(run, "stylus", None)))
    return [(f"{microphones} {tip}", values) for microphones, values in found if len(values)]


def fit(runs: list[Run], out: Path) -> None:
    found: dict[str, list[Floats]] = defaultdict(list)
    with ProcessPoolExecutor(2) as pool:
        for each in pool.map(described, runs):
            for name, values in each:
                found[name].append(values)
    arrays = {}
    for microphones in ("both", "contact", "air"):
        means, covariances = [], []
        for tip in (*SOFT, *HARD, "lmt"):
            if sets := found[f"{microphones} {tip}"]:  # each run weighs the same
                weights = np.concatenate([np.full(len(values), 1 / len(values)) for values in sets])
                values = np.concatenate(sets)
                means.append(np.average(values, axis=0, weights=weights))
                covariances.append(np.cov(values.T, aweights=weights, bias=True))
        covariance = np.mean(covariances, axis=0) + RIDGE_DB**2 * np.eye(len(means[0]))
        arrays |= {f"{microphones}-means": np.array(means), f"{microphones}-precision": np.linalg.inv(covariance)}
    np.savez_compressed(out, **{name: np.float32(values) for name, values in arrays.items()})


def score(runs: list[Run], seconds: float) -> None:
    tips = (*SOFT, *HARD)
    jobs = [(run, tip) for run in runs for tip in tips]
    counts: dict[tuple[str, str], list[tuple[bool, bool, bool]]] = defaultdict(list)
    with ProcessPoolExecutor(2) as pool:
        for (run, tip), found in zip(jobs, pool.map(notices, *zip(*jobs, strict=True)), strict=True):
            times = [time for time, code in found if code == "other-tip"]
            counts[run[0], tip].append((min(times, default=np.inf) <= seconds, bool(times), bool(found)))
    print(f"| sound, `--tip` | {' | '.join(tips)} |\n|---|{'--:|' * len(tips)}")
    for sound in sorted({name for name, _ in counts}):
        cells = []
        for tip in tips:
            soon, ever, anything = np.sum(counts[sound, tip], axis=0)
            cells.append(f"{soon}, {ever} of {len(counts[sound, tip])} (with others {anything})")
        print(f"| {sound} | {' | '.join(cells)} |")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("folders", type=Path, nargs="+")
    parser.add_argument("--out", type=Path)
    parser.add_argument("--seconds", type=float, default=10.0)
    args = parser.parse_args()
    runs = [run for folder in args.folders for run in runs_of(folder)]
    if root := os.environ.get("TACTOPHONE_RECORDINGS"):
        real = runs_of(Path(root, "lmt"))
        runs += [run for run in real if int(run[1][0].surface[1]) % 2 == bool(args.out)]
    if args.out:
        fit(runs, args.out)
    else:
        score(runs, args.seconds)


if __name__ == "__main__":
    main()
