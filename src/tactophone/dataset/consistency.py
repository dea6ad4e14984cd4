"""Checks across recordings: leaks, duplicates and imbalance; and takes without contact."""

import hashlib
from collections import Counter
from collections.abc import Callable, Iterator

import numpy as np

from tactophone.dataset.values import Dataset, Problem, Recording
from tactophone.errors import DatasetError
from tactophone.types import CONTACT, Touch

DEFAULT_CONTACT_DBFS = -60.0
"""RMS of a quarter second under which there is no contact on any set-up; a calibration knows the exact level."""

MIN_CONTACT = 0.05
"""Share of a take that must be in contact."""

MIN_LABEL_SHARE = 0.25
"""Of the surfaces, for either label; the paper has 0.43 rough objects."""

CELL = 0.25
"""Seconds over which a level is measured."""


def check_consistency(
    dataset: Dataset,
    *,
    threshold_dbfs: float = DEFAULT_CONTACT_DBFS,
    progress: Callable[[int], None] = lambda done: None,
) -> tuple[Problem, ...]:
    """Read every readable recording, and report what is wrong with the set as a whole.

    Faults of single files are reported by :func:`tactophone.dataset.check` instead. ``threshold_dbfs`` is the level of
    contact over a quarter second; ``progress`` is called with the number of recordings done.
    """
    problems = [*_leaks(dataset), *_imbalance(dataset)]
    seen: dict[str, Recording] = {}
    for done, recording in enumerate(dataset.recordings, 1):
        measured = _measure(recording, threshold_dbfs)
        if measured is not None:
            digest, contact = measured
            problems += _duplicate(recording, seen.setdefault(digest, recording))
            problems += _without_contact(recording, contact, threshold_dbfs)
        progress(done)
    return tuple(problems)


def _leaks(dataset: Dataset) -> Iterator[Problem]:
    sides: dict[str, set[str]] = {}
    for recording in dataset.recordings:
        if side := recording.known("split"):
            sides.setdefault(recording.surface, set()).add(side)
    for surface, names in sorted(sides.items()):
        if len(names) > 1:
            message = f"{surface} is in {' and '.join(sorted(names))}; keep each surface on one side"
            yield Problem(dataset.root, "leak", message, fatal=False)


def _imbalance(dataset: Dataset) -> Iterator[Problem]:
    surfaces = {
        recording.surface: recording.label
        for recording in dataset.recordings
        if recording.label in (Touch.SMOOTH, Touch.ROUGH)
    }
    counts = Counter(surfaces.values())
    for label in (Touch.SMOOTH, Touch.ROUGH):
        if surfaces and counts[label] < MIN_LABEL_SHARE * len(surfaces):
            message = f"{counts[label]} of {len(surfaces)} surfaces are {label.name.lower()}; record more of them"
            yield Problem(dataset.root, "unbalanced", message, fatal=False)


def _duplicate(recording: Recording, first: Recording) -> Iterator[Problem]:
    if first is recording:
        return
    if first.path == recording.path and first.label is recording.label:
        yield Problem(recording.path, "duplicate", "the manifest names it twice; drop either line", fatal=False)
        return
    message = f"the same sound as {first.path.name}"
    if first.label is not recording.label:
        message += f", but labelled {recording.known('label') or '-'} here and {first.known('label') or '-'} there"
    elif first.known("split") != recording.known("split"):
        message += f", which is in {first.known('split') or '-'} and this in {recording.known('split') or '-'}"
    yield Problem(recording.path, "duplicate", f"{message}; drop either file", fatal=False)


def _without_contact(recording: Recording, contact: float, threshold_dbfs: float) -> Iterator[Problem]:
    if recording.label in (Touch.SMOOTH, Touch.ROUGH) and contact < MIN_CONTACT:
        found = f"over {threshold_dbfs:.0f} dBFS for only {contact:.0%} of the time"
        yield Problem(recording.path, "no contact", f"{found}; record it again, or label it none", fatal=False)


def _measure(recording: Recording, threshold_dbfs: float) -> tuple[str, float] | None:
    """Return a hash of the sound, whatever its container, and the share of it in contact; nothing if unusable."""
    try:
        sound = recording.read()
    except DatasetError:
        return None
    # Rounded to 1e-4, a copy in 16 or 24 bits is the same sound, and two recordings still differ.
    samples, rate = sound.samples.round(4), sound.sample_rate
    channel = recording.channels.index("contact") if "contact" in recording.channels else CONTACT
    if not samples.size or not np.isfinite(samples).all():
        return None  # reported as a fault of the file
    size = max(1, int(CELL * rate))
    # Whole cells only, shape (cells, size): a rest shorter than a cell would bias the share.
    cells = samples[: len(samples) // size * size, channel].reshape(-1, size)
    power = np.square(cells, dtype=np.float64).mean(axis=1) if len(cells) else np.zeros(1)
    digest = hashlib.sha256(f"{rate}".encode() + samples.tobytes()).hexdigest()
    return digest, float(np.mean(power >= 10 ** (threshold_dbfs / 10)))
