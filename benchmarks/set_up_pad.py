"""What `tactophone setup` gains under the pad, as rendered: simulated fingers, objects that no model was trained on.

    python benchmarks/set_up_pad.py [--fingers 24] [--gain -20] [--model texture]

Each finger (a seed: set-up, movement, noise) slides 10 s over each of the ten frozen objects, then two smooth and two
rough ones are drawn, the model is fitted to them as `setup` does, and it renders the other six: with its contact
gate, its thresholds and its abstention. *Windows* are single ones, rough from a half. The contact threshold comes from
5 s of silence, before and after. 90 % intervals are of bootstrap draws of the fingers.
"""

import argparse
import tempfile
from collections import defaultdict
from collections.abc import Iterator
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tactophone.evaluation import interval
from tactophone.perception import Model, WindowDetector, measure_floor, model_path, read_model, with_gate
from tactophone.perception.decision import rough_share
from tactophone.simulation import SimulatedParticipant, catalogue
from tactophone.training.set_up import ObjectSound, collect, fit_set_up
from tactophone.training.set_up_model import write_set_up
from tactophone.types import AudioBlock, FloatArray, Touch

FROZEN = range(23, 33)

SILENCE, SETTLING, SLIDE = 5.0, 1.0, 10.0
"""Seconds of silence, until the finger slides, and of sliding."""

Slides = dict[tuple[str, bool], FloatArray]


def render(seed: int, gain_db: float) -> tuple[int, FloatArray, Slides]:
    """Return the sample rate, silence, and the sliding sound of each object by name and roughness."""
    slides: Slides = {}
    for obj in (each for each in catalogue() if each.number in FROZEN):
        finger = SimulatedParticipant(obj, gain_db=gain_db, seed=seed)
        blocks = iter(finger)
        silence = _collect(blocks, SILENCE, finger.sample_rate)
        finger.stroke(SETTLING + SLIDE)
        _collect(blocks, SETTLING, finger.sample_rate)
        slides[obj.name, obj.label is Touch.ROUGH] = _collect(blocks, SLIDE, finger.sample_rate)
    return finger.sample_rate, silence, slides


def _collect(blocks: Iterator[AudioBlock], duration: float, rate: int) -> FloatArray:
    parts: list[FloatArray] = []
    while sum(map(len, parts)) < duration * rate:
        parts.append(next(blocks).samples)
    return np.concatenate(parts)


def score(model: Model, slides: Slides, *, sample_rate: int, threshold_dbfs: float) -> NDArray[np.float64]:
    """Return shares over objects: rough rendered rough, smooth rendered rough, the same of windows, and silent."""
    shares: dict[bool, list[tuple[float, float, float]]] = defaultdict(list)
    for (_, rough), samples in slides.items():
        detector = with_gate(WindowDetector(model, sample_rate=sample_rate), sample_rate=sample_rate)
        detector.threshold_dbfs = threshold_dbfs
        found = detector.push(AudioBlock(samples, sample_rate))
        windows = [rough_share(each.probabilities) >= 0.5 for each in found if each.level_dbfs >= threshold_dbfs]
        touches = np.array([each.touch for each in found])
        shares[rough].append((np.mean(touches == Touch.ROUGH), np.mean(windows), np.mean(touches == Touch.NONE)))
    rough, smooth = (np.mean(shares[label], axis=0) for label in (True, False))
    return np.array([rough[0], smooth[0], rough[1], smooth[1], (rough[2] + smooth[2]) / 2])


def score_finger(seed: int, gain_db: float, name: str, folder: Path) -> NDArray[np.float64]:
    """Return the scores before and after a set-up, shape ``(2, 5)``, of the six objects that are not drawn."""
    start = model_path(name)
    model = read_model(start)
    rate, silence, slides = render(seed, gain_db)
    threshold = measure_floor([AudioBlock(silence, rate)], sample_rate=rate, rule=model.card.gate.rule).threshold_dbfs
    rng = np.random.default_rng(seed)
    drawn = [key for label in (False, True) for key in _draw(rng, [key for key in slides if key[1] is label])]
    sounds: list[ObjectSound] = [
        collect(model, slides[key], sample_rate=rate, threshold_dbfs=threshold, name=key[0], rough=key[1])
        for key in drawn
    ]
    fit = fit_set_up(sounds, channels=model.card.channels, tip=model.card.tip)
    path = folder / f"{seed}.onnx"
    write_set_up(path, start, model, fit, threshold_dbfs=threshold, tip=model.card.tip)
    rest = {key: sound for key, sound in slides.items() if key not in drawn}
    return np.array(
        [score(each, rest, sample_rate=rate, threshold_dbfs=threshold) for each in (model, read_model(path))]
    )


def _draw(rng: np.random.Generator, keys: list[tuple[str, bool]]) -> list[tuple[str, bool]]:
    return [keys[at] for at in rng.choice(len(keys), 2, replace=False)]


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--fingers", type=int, default=24)
    parser.add_argument("--gain", type=float, default=-20.0, help="of the contact microphone, in dB")
    parser.add_argument("--model", default="texture")
    args = parser.parse_args()
    with tempfile.TemporaryDirectory() as folder:
        scores = np.array([score_finger(seed, args.gain, args.model, Path(folder)) for seed in range(args.fingers)])
    draws = np.random.default_rng(0).integers(len(scores), size=(1000, len(scores)))
    for name, rows in zip(("before", "setup"), scores.swapaxes(0, 1), strict=True):
        for kind, at in (("rendered", 0), ("windows", 2)):
            right = (rows[:, at] + 1 - rows[:, at + 1]) / 2
            balanced = interval(right.mean(), right[draws].mean(axis=1))
            print(
                f"{name}, {kind}: balanced {balanced}, worst {right.min():.2f}; "
                f"rough as rough {rows[:, at].mean():.3f}, smooth as rough {rows[:, at + 1].mean():.3f}; "
                f"silent {rows[:, 4].mean():.3f}"
            )


if __name__ == "__main__":
    main()
