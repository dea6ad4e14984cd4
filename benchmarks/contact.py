"""Is contact found at any gain? Prints the table of the contact page (docs/research/contact.md).

    python benchmarks/contact.py [--simulated DIR] [--lmt DIR]

Simulated: takes as `tactophone simulate dataset DIR --objects all --takes long_medium,wiggle --seconds 6` renders them,
each at four gains, through the gate of the default detector that follows the noise. Real: the recordings of `lmt`
(a folder with manifest.csv; by default that of TACTOPHONE_RECORDINGS), each through the gate of its own floor.
"""

import argparse
import csv
import os
from collections import defaultdict
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import soundfile
from numpy.typing import NDArray

from tactophone.capture import FileSource
from tactophone.dataset import Recording, open_dataset
from tactophone.perception import ContactGate, LoudnessRule, NoiseFloor, measure_floor
from tactophone.perception.noise_floor import HOLD, SPREAD_DB, WINDOW
from tactophone.types import AudioBlock, FloatArray

GAINS_DB = (-30.0, -10.0, 0.0, 10.0)
STEP = 0.01
"""Seconds between two looks at the gate."""

AFTER_LIFT = 0.3
"""Seconds after a lift that count neither as contact nor as silence: the gate holds a touch, and plates ring."""

LEAD, LEAD_TURNS = 0.4, 4
"""Seconds of a take's first silence that are played to and fro before it, and how often: takes begin with half a
second of silence only, a live system has more."""

SKIPPED = 0.6
"""Seconds from the start in which the floor is not known yet."""

NEAR_PEAK_DB = 30.0
"""A window of real sound so near the take's peak is taken for touch."""

START_DBFS: dict[LoudnessRule, float] = {"banded": -38.0, "rms": -26.0}
"""Thresholds of the shipped models, from which the gate starts."""


@dataclass(slots=True)
class Counts:
    """Looks at the gate, and delays in s."""

    silent: int = 0
    false: int = 0
    touched: int = 0
    found: int = 0
    inside: int = 0
    gaps: int = 0
    landings: list[float] = field(default_factory=list)
    lifts: list[float] = field(default_factory=list)

    def row(self) -> list[str]:
        """Return the table's cells."""
        delays = ["-" if not times else f"{1000 * np.quantile(times, q):.{digits}f}"
                  for times, digits in ((self.landings, 1), (self.lifts, 0)) for q in (0.5, 0.95)]  # fmt: skip
        return [
            f"{100 * self.false / self.silent:.2f}", f"{100 * self.found / self.touched:.1f}",
            f"{100 * self.gaps / self.inside:.1f}", *delays,
        ]  # fmt: skip


def score_take(counts: Counts, recording: Recording, rule: LoudnessRule, *, gain_db: float) -> None:
    """Run the gate over a labelled take at a gain and add what it did."""
    samples, rate = soundfile.read(recording.path, dtype="float32", always_2d=True)
    lead = samples[: round(LEAD * rate)]
    turns = [lead if turn % 2 == 0 else lead[::-1] for turn in range(LEAD_TURNS)]
    sound = np.concatenate([*turns, samples])[:, :1] * 10 ** (gain_db / 20)
    sound = np.clip(sound, -1, 1).astype(np.float32)
    floor = NoiseFloor(START_DBFS[rule], spread_db=SPREAD_DB[rule])
    gate = ContactGate(START_DBFS[rule], sample_rate=rate, rule=rule, floor=floor, hold=HOLD)
    offset = LEAD_TURNS * LEAD
    changes = gate.push(AudioBlock(np.ascontiguousarray(sound), rate))
    times = np.array([change.time for change in changes]) - offset
    touching = np.array([change.touching for change in changes])
    looks = np.arange(0, len(samples) / rate, STEP)
    contact = touching[np.maximum(np.searchsorted(times, looks, side="right") - 1, 0)]
    before = np.arange(SKIPPED - offset, 0, STEP)
    counts.silent += len(before)
    counts.false += int(touching[np.searchsorted(times, before, side="right") - 1].sum())
    for segment in recording.segments:
        if segment.contact:
            _score_touch(counts, (segment.start, segment.end), looks, contact, times, touching)
        else:
            after_lift = AFTER_LIFT if segment.start else 0.032
            silent = (looks >= segment.start + after_lift) & (looks < segment.end)
            counts.silent += int(silent.sum())
            counts.false += int(contact[silent].sum())


def _score_touch(
    counts: Counts,
    span: tuple[float, float],
    looks: NDArray[np.float64],
    contact: NDArray[np.bool_],
    times: NDArray[np.float64],
    touching: NDArray[np.bool_],
) -> None:
    start, end = span
    inside = (looks >= start + 0.016) & (looks < end)
    counts.touched += int(inside.sum())
    counts.found += int(contact[inside].sum())
    if len(found := np.flatnonzero(inside & contact)):
        counts.inside += int(inside.sum())
        counts.gaps += int((~contact[found[0] : found[-1]]).sum())
    if len(landed := times[touching & (times >= start) & (times < end)]):
        counts.landings.append(float(landed[0]) - start)
    if end < looks[-1] - AFTER_LIFT and len(lifted := times[~touching & (times > end)]):
        counts.lifts.append(float(lifted[0]) - end)


def simulated_rows(folder: Path) -> Iterator[list[str]]:
    """Yield a row for each rule and gain."""
    recordings = open_dataset(folder).recordings
    for rule in START_DBFS:
        for gain_db in GAINS_DB:
            counts = Counts()
            for recording in recordings:
                score_take(counts, recording, rule, gain_db=gain_db)
            yield [f"{rule}, {gain_db:+.0f} dB", *counts.row()]


def level_tracks(sound: FloatArray, rate: int) -> NDArray[np.float64]:
    """Return the banded level over 32 ms in dBFS, a hundred times a second."""
    from tactophone.perception.step_levels import StepLevels

    steps = StepLevels("banded", sample_rate=rate)
    total = np.concatenate(([0.0], np.cumsum(steps.push(AudioBlock(sound, rate)), dtype=np.float64)))
    window = steps.count(WINDOW)
    powers = (total[window:] - total[:-window])[:: steps.count(STEP)] / window
    return np.asarray(10 * np.log10(np.maximum(powers, 1e-15)))


def real_shares(folder: Path) -> dict[str, tuple[int, int, int]]:
    """Return for each surface the windows near the peak, those found, and takes whose floor was found."""
    found: dict[str, list[int]] = defaultdict(lambda: [0, 0, 0])
    with (folder / "manifest.csv").open(newline="") as file:
        rows = [row for row in csv.DictReader(file) if row["tier"] != "other"]
    for row in rows:
        with FileSource(folder / row["file"]) as source:
            blocks = list(source)
            floor = measure_floor(blocks, sample_rate=source.sample_rate, rule="banded")
        levels = level_tracks(np.concatenate([block.samples for block in blocks]), blocks[0].sample_rate)
        near = levels >= levels.max() - NEAR_PEAK_DB
        counts = found[row["surface"]]
        counts[0] += int(near.sum())
        counts[1] += int((near & (levels >= floor.threshold_dbfs)).sum())
        counts[2] += floor.known
    return {surface: (near, heard, known) for surface, (near, heard, known) in found.items()}


def print_table(header: Sequence[str], rows: Iterator[list[str]]) -> None:
    """Print a Markdown table."""
    print("| " + " | ".join(header) + " |")
    print("|---" + "|--:" * (len(header) - 1) + "|")
    for row in rows:
        print("| " + " | ".join(row) + " |", flush=True)


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--simulated", type=Path)
    recordings = os.environ.get("TACTOPHONE_RECORDINGS")
    parser.add_argument("--lmt", type=Path, default=Path(recordings) / "lmt" if recordings else None)
    args = parser.parse_args()
    if args.simulated:
        header = [
            "rule, gain",
            "false contact %",
            "touch found %",
            "gaps %",
            "touch p50 ms",
            "p95",
            "lift p50 ms",
            "p95",
        ]
        print_table(header, simulated_rows(args.simulated))
    if args.lmt:
        shares = real_shares(args.lmt)
        near, heard, known = (sum(entry[place] for entry in shares.values()) for place in range(3))
        print(
            f"\nreal: {100 * heard / near:.1f} % of {near} windows within {NEAR_PEAK_DB:.0f} dB of the peak are contact"
        )
        worst = sorted((heard / near, name) for name, (near, heard, _) in shares.items())[:3]
        print("worst surfaces: " + ", ".join(f"{name} {100 * share:.1f} %" for share, name in worst))
        print(f"takes in which a noise floor was found, wrongly as all are touch: {known}")


if __name__ == "__main__":
    main()
