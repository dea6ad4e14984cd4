"""Finds what is wrong between recordings: leaks, duplicates, imbalance; and takes in which nothing is touched."""

import hashlib
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
import soundfile

from tactophone.dataset.values import Dataset, Problem, Recording
from tactophone.types import CONTACT, Touch

FAINT_DBFS = -60.0
"""RMS of a quarter second under which nothing is touched, whatever the set-up; a calibration tells better."""

LEAST_CONTACT = 0.05
"""Share of a take that must be in contact."""

LEAST_SHARE = 0.25
"""Of the recordings that either label should have; the paper has 0.43 rough objects."""

CELL = 0.25


def check_together(
    dataset: Dataset, *, threshold_dbfs: float = FAINT_DBFS, progress: Callable[[int], None] = lambda done: None
) -> tuple[Problem, ...]:
    """Read every recording that can be read, and name what is wrong with the set as a whole.

    Parameters
    ----------
    dataset
        Single files' faults are :func:`tactophone.dataset.check`'s to name.
    threshold_dbfs
        Contact level over a quarter second.
    progress
        Called with the number of recordings done.
    """
    found = [*_leaks(dataset), *_imbalance(dataset)]
    seen: dict[str, Recording] = {}
    for done, recording in enumerate(dataset.recordings, 1):
        heard = _hear(recording, threshold_dbfs)
        if heard is not None:
            digest, contact = heard
            found += _duplicate(recording, seen.setdefault(digest, recording))
            found += _untouched(recording, contact, threshold_dbfs)
        progress(done)
    return tuple(found)


def _leaks(dataset: Dataset) -> Iterator[Problem]:
    sides: dict[str, set[str]] = {}
    for one in dataset.recordings:
        if one.known("split"):
            sides.setdefault(one.surface, set()).add(one.known("split"))
    for surface, names in sorted(sides.items()):
        if len(names) > 1:
            told = f"{surface} is in {' and '.join(sorted(names))}; keep all of a surface on one side"
            yield Problem(dataset.root, "leak", told, fatal=False)


def _imbalance(dataset: Dataset) -> Iterator[Problem]:
    surfaces = {one.surface: one.label for one in dataset.recordings if one.label in (Touch.SMOOTH, Touch.ROUGH)}
    counted = Counter(label for label in surfaces.values() if label is not None)
    for label in (Touch.SMOOTH, Touch.ROUGH):
        if surfaces and counted[label] < LEAST_SHARE * len(surfaces):
            told = f"{counted[label]} of {len(surfaces)} surfaces are {label.name.lower()}; record more of them"
            yield Problem(dataset.root, "unbalanced", told, fatal=False)


def _duplicate(recording: Recording, first: Recording) -> Iterator[Problem]:
    if first is recording:
        return
    told = f"the same sound as {first.path.name}"
    if first.label is not recording.label:
        told += f", but labelled {recording.known('label') or '-'} here and {first.known('label') or '-'} there"
    elif first.known("split") != recording.known("split"):
        told += f", which is in {first.known('split') or '-'} and this in {recording.known('split') or '-'}"
    yield Problem(recording.path, "duplicate", f"{told}; drop one of them", fatal=False)


def _untouched(recording: Recording, contact: float, threshold_dbfs: float) -> Iterator[Problem]:
    if recording.label in (Touch.SMOOTH, Touch.ROUGH) and contact < LEAST_CONTACT:
        told = f"over {threshold_dbfs:.0f} dBFS for {contact:.0%} of the time only; record it again, or label it none"
        yield Problem(recording.path, "no contact", told, fatal=False)


def _hear(recording: Recording, threshold_dbfs: float) -> tuple[str, float] | None:
    """Give a hash of the sound itself, whatever its container, and the share of it in contact."""
    try:
        samples, rate = _read(recording.path)
    except (soundfile.LibsndfileError, OSError):
        return None
    order = recording.channels.index("contact") if "contact" in recording.channels else CONTACT
    size = max(1, int(CELL * rate))
    whole = samples[: len(samples) // size * size, order].reshape(-1, size)
    power = np.square(whole, dtype=np.float64).mean(axis=1) if len(whole) else np.zeros(1)
    digest = hashlib.sha256(f"{rate}".encode() + samples.tobytes()).hexdigest()
    return digest, float(np.mean(power >= 10 ** (threshold_dbfs / 10)))


def _read(path: Path) -> tuple[np.ndarray, int]:
    with soundfile.SoundFile(path) as file:
        # Sixteen bits tell two recordings apart; a copy at 24 bits is still the same sound.
        return file.read(dtype="float32", always_2d=True).round(4), int(file.samplerate)
