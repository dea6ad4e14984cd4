"""Edges between smooth and rough without a lift-off, joined from recordings of held-out surfaces.

The finger lifts between objects in the recordings, so edges are synthesised: the middle of a touch on one surface,
cross-faded into the middle of a touch on another over the time that a fingertip takes to cross an edge.
"""

import hashlib
from collections.abc import Iterator, Sequence
from pathlib import Path
from types import MappingProxyType

import numpy as np
import soundfile

from tactophone.dataset import Recording, Segment
from tactophone.dataset.motion_intervals import MotionInterval, cut_slides, write_slides
from tactophone.evaluation.true_contact import touches_of
from tactophone.types import FloatArray, Touch

HALF = 0.6
"""Seconds of each surface."""

FADE = 0.02
"""Seconds: 2 mm of contact at 10 cm/s."""

LEAD = 0.2
"""Seconds of silence before, so that running statistics begin empty."""

VERSION = 2
"""Of the joining, in the files' names: 2 fades in, where 1 began with a click."""

_WORDS = {Touch.SMOOTH: "smooth", Touch.ROUGH: "rough"}


SOURCES = "sources"
"""Property of an edge: the paths of the two recordings that it is joined from, by line."""


def join_edges(recordings: Sequence[Recording], folder: Path, *, most: int = 40, seed: int = 0) -> list[Recording]:
    """Join pairs of a smooth and a rough touch, in either order, and write them as FLAC; [] without both classes.

    The recordings are held out, of one sample rate. The files are named by
    content and written once; ``most`` limits the number of edges. Raises `ValueError` if the two recordings of a pair
    differ in sample rate.
    """
    pools = {label: list(_touches(recordings, label)) for label in _WORDS}
    if not all(pools.values()):
        return []
    rng = np.random.default_rng(seed)
    folder.mkdir(parents=True, exist_ok=True)
    edges = []
    for number in range(min(most, 2 * min(map(len, pools.values())))):
        order = (Touch.SMOOTH, Touch.ROUGH) if number % 2 == 0 else (Touch.ROUGH, Touch.SMOOTH)
        pair = [pools[label][int(rng.integers(len(pools[label])))] for label in order]
        if pair[0][0].channels == pair[1][0].channels:
            edges.append(_join(pair, order, folder))
    return edges


def _touches(recordings: Sequence[Recording], label: Touch) -> Iterator[tuple[Recording, float]]:
    """Each touch long enough, with the start in s of its middle part."""
    for recording in recordings:
        if recording.label is not label:
            continue
        touches = touches_of(recording)
        for start, end in ((0.0, soundfile.info(recording.path).duration),) if touches is None else touches:
            if end - start >= HALF + 0.1:
                yield recording, (start + end - HALF) / 2


def _join(pair: Sequence[tuple[Recording, float]], order: Sequence[Touch], folder: Path) -> Recording:
    name = hashlib.sha256(
        repr([VERSION, *((str(recording.path), start) for recording, start in pair)]).encode()
    ).hexdigest()[:16]
    path = folder / f"{name}.flac"
    (first, rate), (second, other) = (_read(recording.path, start) for recording, start in pair)
    if rate != other:
        raise ValueError(f"{pair[0][0].path} has {rate} Hz, {pair[1][0].path} {other} Hz: edges join equal rates")
    if not path.is_file():
        soundfile.write(path, _fade(first, second, rate), rate, subtype="PCM_16")
    middle, end = LEAD + HALF - FADE / 2, LEAD + 2 * HALF - FADE
    segments = (
        Segment(0.0, LEAD, "none"),
        Segment(LEAD, middle, _WORDS[order[0]]),
        Segment(middle, end, _WORDS[order[1]]),
    )
    sources = {SOURCES: "\n".join(str(take.path) for take, _ in pair)}
    return Recording(path, f"{pair[0][0].surface} to {pair[1][0].surface}", None, pair[0][0].channels,
                     segments=segments, properties=MappingProxyType(_motion(pair) | sources))  # fmt: skip


def _motion(pair: Sequence[tuple[Recording, float]]) -> dict[str, str]:
    """The slides of the joined recording, if both recordings have them labelled."""
    places = (LEAD, LEAD + HALF - FADE)
    cuts = [cut_slides(recording, start, start + HALF, place=place)
            for (recording, start), place in zip(pair, places, strict=True)]  # fmt: skip
    if cuts[0] is None or cuts[1] is None:
        return {}
    # A slide that continues over the edge is one slide.
    last, first = cuts[0][-1:], cuts[1][:1]
    if last and first and first[0].start <= last[0].end:
        return {"slides": write_slides((*cuts[0][:-1], MotionInterval(last[0].start, first[0].end), *cuts[1][1:]))}
    return {"slides": write_slides((*cuts[0], *cuts[1]))}


def _read(path: Path, start: float) -> tuple[FloatArray, int]:
    with soundfile.SoundFile(path) as file:
        file.seek(round(start * file.samplerate))
        return file.read(round(HALF * file.samplerate), dtype="float32", always_2d=True), file.samplerate


def _fade(first: FloatArray, second: FloatArray, rate: int) -> FloatArray:
    """Fade in from silence, then cross-fade with constant power, because the two sounds are uncorrelated.

    Sound cut into digital silence would begin with a click that no finger makes.
    """
    size = round(FADE * rate)
    angle = np.linspace(0, np.pi / 2, size, dtype=np.float32)[:, None]
    landing = first[:size] * np.sin(angle) ** 2
    crossing = first[-size:] * np.cos(angle) + second[:size] * np.sin(angle)
    silence = np.zeros((round(LEAD * rate), first.shape[1]), np.float32)
    return np.concatenate((silence, landing, first[size:-size], crossing, second[size:]))
