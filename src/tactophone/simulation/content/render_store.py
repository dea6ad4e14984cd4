"""Simulated sound on disk: whole files or none, each knowing what it is.

A file is written beside its place and moved there, so that a kill leaves nothing half done. Its comment tag holds how
it was made and what truly happened in it: a second run needs neither sound nor side file to know that it is done.
"""

import json
import os
from collections.abc import Iterable
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
import soundfile
from numpy.typing import NDArray

from tactophone.dataset import Segment
from tactophone.link import Codec, round_trip
from tactophone.simulation.physics.scene import Scene
from tactophone.simulation.physics.source import RATE
from tactophone.types import FloatArray, Touch

SHORTEST = 0.03
"""Seconds; a shorter stretch of truth is joined to the one before it: the hop of a finger, not its will."""


@dataclass(frozen=True, slots=True)
class RenderMetadata:
    """How a file was made (``recipe``), and what is touched when: segments, and the index of the thing in each."""

    recipe: str
    segments: tuple[Segment, ...]
    things: tuple[int, ...]


def write_sound(path: Path, samples: FloatArray, story: RenderMetadata, *, bits: int = 16) -> None:
    """Write WAV or FLAC, by the path's suffix, at once and whole."""
    path.parent.mkdir(parents=True, exist_ok=True)
    unfinished = path.with_name(f".{path.name}.part")  # one name: what a kill leaves, the next run writes over
    told = [[one.start, one.end, one.word, thing] for one, thing in zip(story.segments, story.things, strict=True)]
    try:
        with soundfile.SoundFile(
            unfinished, "w", RATE, samples.shape[1], f"PCM_{bits}", format=path.suffix[1:].upper()
        ) as file:
            file.comment = json.dumps({"recipe": story.recipe, "segments": told})
            file.write(samples)
        os.replace(unfinished, path)
    finally:
        unfinished.unlink(missing_ok=True)


def read_metadata_of(path: Path) -> RenderMetadata | None:
    """Give a file's story, or nothing if it is not there or not ours."""
    try:
        with soundfile.SoundFile(path) as file:
            told = json.loads(file.comment)
        segments = tuple(Segment(start, end, word) for start, end, word, _ in told["segments"])
        return RenderMetadata(told["recipe"], segments, tuple(thing for *_, thing in told["segments"]))
    except (OSError, soundfile.LibsndfileError, ValueError, KeyError, TypeError):
        return None


def tell(things: NDArray[np.int16], scene: Scene) -> tuple[tuple[Segment, ...], tuple[int, ...]]:
    """Tell what is touched when, from the truth's ``thing`` per sample; the ground's word is *contact*."""
    bounds = np.concatenate([[0], np.flatnonzero(np.diff(things)) + 1, [len(things)]])
    runs = list(_joined((int(a), int(b), int(things[a])) for a, b in pairwise(bounds) if b > a))
    segments = tuple(Segment(round(a / RATE, 4), round(b / RATE, 4), _word(thing, scene)) for a, b, thing in runs)
    return segments, tuple(thing for _, _, thing in runs)


def through_opus(samples: FloatArray) -> FloatArray:
    """Pass sound through the link's codec and back, its look-ahead taken off, as training sound in the paper was."""
    return round_trip(samples, Codec("opus", channels=samples.shape[1], packet_size=480, bandwidth=20_000))


def _joined(runs: Iterable[tuple[int, int, int]]) -> Iterable[tuple[int, int, int]]:
    last: tuple[int, int, int] | None = None
    for start, end, thing in runs:
        if last and (thing == last[2] or end - start < SHORTEST * RATE):
            last = (last[0], end, last[2])
            continue
        if last:
            yield last
        last = (start, end, thing)
    if last:
        yield last


def _word(thing: int, scene: Scene) -> str:
    if thing < 0:
        return Touch.NONE.name.lower()
    label = scene.things[thing].label
    return "contact" if label is Touch.NONE else label.name.lower()
