"""What mains hum costs `tactophone feel`, as it is and with its lines subtracted first as `feel` does.

    python benchmarks/hum.py DATASET [--tip stylus] [--model NAME] [--takes 2]

Hum of 50 or 60 Hz (with half of the third harmonic, off by up to 0.1 %) is added to the recordings of a labelled data
set, at several levels. *Right*: share of the contact (without labels over time: of what is within 30 dB of the take's
loudest) that is rendered as its label, balanced over the classes. With real recordings (`lmt`) every run is a look:
enter it in docs/research/looks.md.
"""

import argparse
from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Self

import numpy as np
from numpy.typing import NDArray

from tactophone.capture import FileSource
from tactophone.dataset import Recording, Segment, open_dataset
from tactophone.offline import Preparation, PreparedSource
from tactophone.perception import default_model, measure_floor, model_path, read_model
from tactophone.pipeline import open_pipeline
from tactophone.types import DEFAULT_TIP, TIP_NAMES, AudioBlock, FloatArray, Touch

AUDIBLE_DB = 30.0

LEVELS_DBFS = (None, -63.0, -53.0, -43.0, -33.0, -23.0)


class Sound:
    """Sound in memory as a source."""

    def __init__(self, samples: FloatArray, sample_rate: int) -> None:
        self.samples, self.sample_rate, self.channels = samples, sample_rate, samples.shape[1]

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *error: object) -> None:
        return

    def __iter__(self) -> Iterator[AudioBlock]:
        for start in range(0, len(self.samples), 4096):
            yield AudioBlock(self.samples[start : start + 4096], self.sample_rate, start)


def hum(size: int, rate: int, *, level_dbfs: float, rng: np.random.Generator) -> FloatArray:
    """Return hum, shape ``(size, 1)``."""
    mains = rng.choice((50.0, 60.0)) * (1 + rng.uniform(-1e-3, 1e-3))
    phase = 2 * np.pi * mains * np.arange(size) / rate
    wave = np.cos(phase + rng.uniform(0, 6)) + 0.5 * np.cos(3 * phase + rng.uniform(0, 6))
    return np.asarray(wave / wave.std() * 10 ** (level_dbfs / 20), np.float32)[:, None]


def rendered(
    sound: Sound, segments: Sequence[Segment], preparation: Preparation, model: str, tip: str
) -> NDArray[np.int64]:
    """Return the updates in contact, counted by what is rendered: none, smooth, rough."""
    rule = read_model(model_path(model)).card.gate.rule
    floor = measure_floor(PreparedSource(sound, preparation), sample_rate=sound.sample_rate, rule=rule)
    preparation = preparation.amplified(floor.loudest_dbfs)
    prepared = PreparedSource(sound, preparation)
    if preparation.gain_db:
        floor = measure_floor(prepared, sample_rate=sound.sample_rate, rule=rule)
    pipeline = open_pipeline(model, sample_rate=sound.sample_rate, channels=sound.channels, tip=tip, follow_floor=False)
    pipeline.threshold_dbfs = floor.threshold_dbfs
    updates = [update for block in prepared for update in pipeline.push(block).predictions]
    level, end = np.array([(update.level_dbfs, update.end) for update in updates]).T
    spans = [segment for segment in segments if segment.contact]
    contact = level >= level.max() - AUDIBLE_DB
    if spans:
        contact = np.any([(end > span.start) & (end <= span.end) for span in spans], axis=0)
    touches = np.array([update.touch for update in updates], int)
    return np.bincount(touches[contact], minlength=3)


def read(recording: Recording) -> Sound:
    with FileSource(recording.path) as source:
        return Sound(np.concatenate([block.samples for block in source]), source.sample_rate)


def main() -> None:
    """Print a row for each level."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("dataset", type=Path)
    parser.add_argument("--tip", choices=TIP_NAMES, default=DEFAULT_TIP)
    parser.add_argument("--model", default="")
    parser.add_argument("--takes", type=int, default=2)
    args = parser.parse_args()
    model = args.model or default_model(args.tip)
    takes: dict[str, list[Recording]] = defaultdict(list)
    for recording in open_dataset(args.dataset).labelled().recordings:
        takes[recording.surface].append(recording)
    print("| hum, dBFS | as it is | hum subtracted | found in |\n|---|--:|--:|--:|")
    for level in LEVELS_DBFS:
        rng, found, count = np.random.default_rng(0), 0, 0
        shares: dict[tuple[bool, Touch], list[float]] = defaultdict(list)
        for recording in (take for surface in takes.values() for take in surface[: args.takes]):
            sound = read(recording)
            if level is not None:
                sound.samples = sound.samples + hum(len(sound.samples), sound.sample_rate, level_dbfs=level, rng=rng)
            preparation = Preparation.of(sound)
            found, count = found + (preparation.hum is not None), count + 1
            label = Touch(recording.label or 0)
            for subtracted in (False, True):
                changed = preparation.for_tip(args.tip) if subtracted else replace(preparation, hum=None)
                counts = rendered(sound, recording.segments, changed, model, args.tip)
                shares[subtracted, label].append(counts[label] / counts.sum())
        right = [
            np.mean([np.mean(shares[subtracted, label]) for label in (Touch.SMOOTH, Touch.ROUGH)])
            for subtracted in (False, True)
        ]
        name = "none" if level is None else f"{level:.0f}"
        print(f"| {name} | {right[0]:.3f} | {right[1]:.3f} | {found} of {count} |", flush=True)


if __name__ == "__main__":
    main()
