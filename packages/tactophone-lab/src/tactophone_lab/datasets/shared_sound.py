"""Sound that occurs in two recordings, found by its content.

A recording that was cut into clips, with or without overlap, gives clips that a split
by name puts on both sides, and the detector is then asked for what it was trained on.
The clips may begin anywhere, so blocks at fixed places would never match. Blocks are
therefore placed by the sound itself: around each sample that is the largest for a while
before and after it. A clip holds the same peaks as its neighbour, wherever it begins.
"""

import hashlib
from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator, Mapping
from contextlib import suppress
from dataclasses import dataclass
from itertools import combinations

import numpy as np
from numpy.typing import NDArray

from tactophone.core.errors import DatasetError
from tactophone.core.recordings.values import Dataset, Problem, Recording
from tactophone.core.types import FloatArray
from tactophone_lab.datasets.splits import Fold, kin_of

PEAK_REACH = 1000
"""Samples before and after a peak in which none is larger. At 48 kHz noise then has
about 24 peaks a second."""

PASSAGE = 32
"""Samples before and after a peak that are compared: 64 samples of 16 bits repeat only
where the sound does."""

LEAST_DIFFERENT = 16
"""Different values that a passage has at least: silence and clipped tops are alike in
all recordings."""

LEAST_SHARED = 2
"""Passages that two recordings share from which they hold the same sound."""

LEAST_SHARE = 0.1
"""Share of the shorter recording's passages that have to be the same. A simulated
finger has the same noise in each recording of one seed, until it touches."""

LEAST_DENSE = 0.5
"""Share of the passages from the first to the last shared one that have to be the same,
as a clip is one stretch. The noise of one seed is the same in pauses alone."""

FULL_SCALE = 1 << 15
"""Steps of a 16-bit converter, in which passages are compared: a copy in 24 bits or in
floating point is the same sound."""


@dataclass(frozen=True, slots=True)
class SharedSound:
    """Two recordings that hold the same sound for a while."""

    first: Recording
    second: Recording
    passages: int
    """How many passages around a peak are the same in both."""


def passages_of(samples: FloatArray) -> Mapping[bytes, int]:
    """Return hashes of a channel's passages, the same wherever a clip of it begins, and
    the sample around which each stands.

    >>> sound = np.random.default_rng(0).normal(0, 0.1, 20000).astype(np.float32)
    >>> len(passages_of(sound).keys() & passages_of(sound[1234:]).keys()) > 4
    True
    """
    if len(samples) <= 2 * PEAK_REACH:
        return {}
    steps = np.rint(samples * FULL_SCALE).astype(np.int32)
    found: dict[bytes, int] = {}
    for peak in _peaks(np.abs(steps)):
        passage = steps[peak - PASSAGE : peak + PASSAGE]
        if len(np.unique(passage)) >= LEAST_DIFFERENT:
            digest = hashlib.blake2b(passage.tobytes(), digest_size=12).digest()
            found[digest] = int(peak)
    return found


def _peaks(size: NDArray[np.int32]) -> NDArray[np.intp]:
    """Return where a value is larger than all of the `PEAK_REACH` before it, and as
    large as any after it.

    In silence, and where sound is clipped or constant, all values are alike, and none
    is a peak.
    """
    around = _running_maximum(size, 2 * PEAK_REACH + 1)
    before = _running_maximum(size, PEAK_REACH)[: len(around)]
    middle = size[PEAK_REACH : PEAK_REACH + len(around)]
    return np.flatnonzero((middle == around) & (middle > before)) + PEAK_REACH


def _running_maximum(size: NDArray[np.int32], width: int) -> NDArray[np.int32]:
    """Return the largest of each ``width`` neighbours, by the place of the first.

    This is van Herk's way (Pattern Recogn. Lett. 13, 517, 1992): the larger of a
    maximum up to the end of one block and one from the start of the next.
    """
    blocks = np.pad(size, (0, -len(size) % width)).reshape(-1, width)
    forwards = np.maximum.accumulate(blocks, axis=1).ravel()
    backwards = np.maximum.accumulate(blocks[:, ::-1], axis=1)[:, ::-1].ravel()
    count = len(size) - width + 1
    return np.maximum(backwards[:count], forwards[width - 1 : width - 1 + count])


def shared_sound(
    passages: Iterable[tuple[Recording, Mapping[bytes, int]]],
) -> tuple[SharedSound, ...]:
    """Return each pair of recordings that share a stretch of sound."""
    recordings: list[Recording] = []
    found: list[Mapping[bytes, int]] = []
    places: dict[bytes, list[int]] = defaultdict(list)
    for number, (recording, own) in enumerate(passages):
        recordings.append(recording)
        found.append(own)
        for passage in own:
            places[passage].append(number)
    counts = Counter(
        pair for numbers in places.values() for pair in combinations(numbers, 2)
    )
    return tuple(
        SharedSound(recordings[one], recordings[other], count)
        for (one, other), count in sorted(counts.items())
        if count >= LEAST_SHARED and _is_stretch(found[one], found[other])
    )


def _is_stretch(one: Mapping[bytes, int], other: Mapping[bytes, int]) -> bool:
    """Return whether two recordings share one stretch, and not moments here and
    there."""
    shared = one.keys() & other.keys()
    if len(shared) < LEAST_SHARE * min(len(one), len(other)):
        return False
    for own in (one, other):
        first = min(own[passage] for passage in shared)
        last = max(own[passage] for passage in shared)
        between = sum(first <= place <= last for place in own.values())
        if len(shared) < LEAST_DENSE * between:
            return False
    return True


def find_shared(recordings: Iterable[Recording]) -> tuple[SharedSound, ...]:
    """Read recordings and return the pairs that share sound; one that cannot be read
    shares none."""

    def heard() -> Iterator[tuple[Recording, Mapping[bytes, int]]]:
        for recording in recordings:
            with suppress(DatasetError):
                sound = recording.read(channels=1)
                if sound.invalid is None:
                    yield recording, passages_of(sound.samples[:, 0])

    return shared_sound(heard())


def leak_warnings(dataset: Dataset, folds: Iterable[Fold]) -> list[str]:
    """Return a sentence for each way in which the same sound stands twice in what is
    scored: across a fold, else under two surfaces."""
    shared = find_shared(dataset.recordings)
    across = leaks_across(folds, shared)
    if across:
        count = sum(across.values())
        return [
            f"warning: {count} tested recordings hold sound that was trained on, so "
            "the "
            f"scores are too good ({', '.join(sorted(across))}); `tactophone dataset "
            f"check {dataset.root}` names them"
        ]
    leaks = list(leaks_between_surfaces(shared))
    if leaks:
        return [
            f"warning: {len(leaks)} times the same sound stands under two surfaces, "
            f"such as {leaks[0]}"
        ]
    return []


def leaks_between_surfaces(shared: Iterable[SharedSound]) -> Iterator[Problem]:
    """Warn of sound that occurs under two surfaces, or on both sides of the data set's
    own split."""
    for pair in shared:
        one, other = pair.first, pair.second
        name = one.path.name
        if one.surface != other.surface:
            words = (
                f"holds the same sound as {name}, but is {other.surface} and that "
                f"{one.surface}; give clips of one recording one surface, or one kin"
            )
        elif one.known("split") != other.known("split"):
            words = (
                f"holds the same sound as {name}, which is in "
                f"{one.known('split') or '-'}"
                f" and this in {other.known('split') or '-'}; keep both on one side"
            )
        else:
            continue
        if kin_of(one) != kin_of(other) or one.surface == other.surface:
            yield Problem(other.path, "leak", words, fatal=False)


def leaks_across(
    folds: Iterable[Fold], shared: Iterable[SharedSound]
) -> Mapping[str, int]:
    """Return how many recordings of each fold's test set hold sound of its training
    set, by the fold's name; folds without any are left out."""
    partners: dict[object, set[object]] = defaultdict(set)
    for pair in shared:
        partners[pair.first.path].add(pair.second.path)
        partners[pair.second.path].add(pair.first.path)
    found = {}
    for fold in folds:
        trained = {recording.path for recording in fold.train}
        heard = [each for each in fold.test if partners[each.path] & trained]
        if heard:
            found[fold.name] = len(heard)
    return found
