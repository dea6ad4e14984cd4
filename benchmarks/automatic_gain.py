"""What automatic gain and a noise gate do to contact, in a recording and live.

    make sets && python benchmarks/automatic_gain.py build/sets/pad-test

From each of some simulated takes, six touches of 0.8 s with pauses of 1.2 s over steady
noise, 35 dB under the touch; then a gain that follows the level, or a gate that closes
in the pauses. A row prints the share that is contact, in a recording and live.
"""

import argparse
from collections.abc import Callable, Iterable
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tactophone import Prediction, Touch, open_pipeline, open_recording
from tactophone.core.types import AudioBlock
from tactophone_lab.datasets.open import open_dataset

Sound = NDArray[np.float64]
"""Samples of contact and air, ``(samples, channels)``."""

TOUCHES = 6
TOUCH = 0.8
PAUSE = 1.2
NOISE_DB = -35.0
HOP = 0.005
"""Seconds from one value of a gain to the next."""

TARGET_DBFS = -25.0
ATTACK = 0.02
"""Level that automatic gain aims at, and seconds in which it turns down."""

LEAST_GAIN_DB = -20.0
BLOCK = 480


def strokes(take: Sound, rate: int, random: np.random.Generator) -> Sound:
    """Return touches cut from the middle of a take, each after a pause."""
    touch = take[round(0.3 * len(take)) :][: round(TOUCH * rate)]
    period = np.concatenate([np.zeros((round(PAUSE * rate), take.shape[1])), touch])
    sound = np.tile(period, (TOUCHES, 1))
    level = 10 ** (NOISE_DB / 20) * np.sqrt((touch**2).mean(axis=0))
    return sound + random.normal(0, level, sound.shape)


def followed(sound: Sound, rate: int, seconds: float, most_db: float) -> Sound:
    """Return sound whose gain follows its level, up within ``seconds``."""
    powers = powers_of(sound, rate)
    level = powers[:20].mean()
    gains = np.empty(len(powers))
    for at, power in enumerate(powers):
        within = ATTACK if power > level else seconds
        level += (1 - np.exp(-HOP / within)) * (power - level)
        gains[at] = TARGET_DBFS - 10 * np.log10(level + 1e-12)
    return amplified(sound, rate, gains.clip(LEAST_GAIN_DB, most_db))


def gated(sound: Sound, rate: int, closed_db: float) -> Sound:
    """Return sound that is turned down by ``closed_db`` 0.1 s after a touch, and up
    again with the next."""
    powers = powers_of(sound, rate)
    loud = powers > 30 * np.quantile(powers, 0.2)
    held = np.convolve(loud, np.ones(round(0.1 / HOP)))[: len(loud)] > 0
    eased = np.convolve(held, np.ones(4) / 4)[: len(held)]
    return amplified(sound, rate, closed_db * (1 - eased))


def powers_of(sound: Sound, rate: int) -> NDArray[np.float64]:
    hop = round(HOP * rate)
    whole = len(sound) // hop * hop
    return (sound[:whole] ** 2).mean(axis=1).reshape(-1, hop).mean(axis=1)


def amplified(sound: Sound, rate: int, gains_db: NDArray[np.float64]) -> Sound:
    times = np.arange(len(gains_db)) * round(HOP * rate)
    gain_db = np.interp(np.arange(len(sound)), times, gains_db)
    return sound * 10 ** (gain_db / 20)[:, None]


WAYS: dict[str, Callable[[Sound, int], Sound]] = {
    "fixed gain": lambda sound, rate: sound,
    **{
        f"gain within {seconds:g} s, up to {most_db} dB": (
            lambda sound, rate, seconds=seconds, most_db=most_db: followed(
                sound, rate, seconds, most_db
            )
        )
        for seconds in (0.3, 1.0, 3.0)
        for most_db in (12, 20, 30)
    },
    "gate, 40 dB": lambda sound, rate: gated(sound, rate, -40.0),
    "gate, all": lambda sound, rate: gated(sound, rate, -200.0),
}


def recorded(samples: NDArray[np.float32], rate: int) -> list[Prediction]:
    opened = open_recording(samples, sample_rate=rate)
    return [each for step in opened.steps() for each in step.predictions]


def live(samples: NDArray[np.float32], rate: int) -> list[Prediction]:
    pipeline = open_pipeline(sample_rate=rate, channels=samples.shape[1])
    return [
        each
        for start in range(0, len(samples), BLOCK)
        for each in pipeline.push(
            AudioBlock(samples[start : start + BLOCK], rate, start)
        ).predictions
    ]


def shares(predictions: Iterable[Prediction]) -> tuple[float, float]:
    """Return the shares of touches and of pauses that are contact."""
    found = [(each.end, each.touch is not Touch.NONE) for each in predictions]
    ends, contact = (np.array(part) for part in zip(*found, strict=True))
    touched = ends % (PAUSE + TOUCH) > PAUSE
    return float(contact[touched].mean()), float(contact[~touched].mean())


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("dataset", type=Path, help="simulated takes of the pad")
    parser.add_argument("--takes", type=int, default=6, help="how many (default: 6)")
    parser.add_argument(
        "--ways",
        nargs="*",
        default=WAYS,
        choices=WAYS,
        metavar="WAY",
        help=f"of: {'; '.join(WAYS)} (default: all)",
    )
    arguments = parser.parse_args()
    takes = open_dataset(arguments.dataset).labelled().recordings
    takes = takes[:: max(1, len(takes) // arguments.takes)][: arguments.takes]
    print("Shares of the time that are contact.\n")
    print("| | touches, in a recording | live | pauses, in a recording | live |")
    print("|---|--:|--:|--:|--:|")
    for way in arguments.ways:
        rows = []
        for seed, recording in enumerate(takes):
            take = recording.read()
            random = np.random.default_rng(seed)
            made = strokes(take.samples.astype(float), take.sample_rate, random)
            made = WAYS[way](made, take.sample_rate)
            made /= max(1.0, 1.01 * np.abs(made).max())
            samples = made.astype(np.float32)
            (touch, pause), (live_touch, live_pause) = (
                shares(heard(samples, take.sample_rate)) for heard in (recorded, live)
            )
            rows.append((touch, live_touch, pause, live_pause))
        means = " | ".join(f"{mean:.2f}" for mean in np.mean(rows, axis=0))
        print(f"| {way} | {means} |", flush=True)


if __name__ == "__main__":
    main()
