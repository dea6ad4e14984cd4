"""Simulated sound on disk: complete files or none, each with its ground truth.

A file is written under a temporary name and renamed, so that a kill leaves no half-written file. Its comment tag holds
a fingerprint of its parameters and the touched objects over time: finished files need no side file.
"""

import json
from collections.abc import Iterable
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np
import soundfile
from numpy.typing import NDArray

from tactophone.dataset import Segment
from tactophone.link import Codec, encode_and_decode
from tactophone.processes import atomic_write
from tactophone.simulation.physics.scene import Scene
from tactophone.types import LIVE_SAMPLE_RATE, FloatArray, Touch

SHORTEST = 0.03
"""Seconds; a shorter segment is merged into the one before it: the finger has bounced, not moved on."""


@dataclass(frozen=True, slots=True)
class RenderMetadata:
    """A file's parameters as a ``fingerprint``, and what is touched when: segments and each one's object index."""

    fingerprint: str
    segments: tuple[Segment, ...]
    object_indices: tuple[int, ...]


def write_sound(path: Path, samples: FloatArray, metadata: RenderMetadata, *, bits: int = 16) -> None:
    """Write WAV or FLAC, by the path's suffix; the file appears complete or not at all."""
    segments = [
        [segment.start, segment.end, segment.label_name, index]
        for segment, index in zip(metadata.segments, metadata.object_indices, strict=True)
    ]
    with (
        atomic_write(path) as unfinished,
        soundfile.SoundFile(
            unfinished, "w", LIVE_SAMPLE_RATE, samples.shape[1], f"PCM_{bits}", format=path.suffix[1:].upper()
        ) as file,
    ):
        file.comment = json.dumps({"fingerprint": metadata.fingerprint, "segments": segments})
        file.write(samples)


def read_render_metadata(path: Path) -> RenderMetadata | None:
    """Read a file's metadata; ``None`` if the file is missing or was not written by :func:`write_sound`."""
    try:
        with soundfile.SoundFile(path) as file:
            comment = json.loads(file.comment)
        segments = tuple(Segment(start, end, name) for start, end, name, _ in comment["segments"])
        return RenderMetadata(comment["fingerprint"], segments, tuple(index for *_, index in comment["segments"]))
    except (OSError, soundfile.LibsndfileError, ValueError, KeyError, TypeError):
        return None


def touch_segments(object_index: NDArray[np.int16], scene: Scene) -> tuple[tuple[Segment, ...], tuple[int, ...]]:
    """Turn the truth's ``object_index`` per sample into segments and their object indices.

    A segment is named by its object's label, the ground *contact*, the air *none*.
    """
    bounds = np.concatenate([[0], np.flatnonzero(np.diff(object_index)) + 1, [len(object_index)]])
    runs = list(_merged((int(a), int(b), int(object_index[a])) for a, b in pairwise(bounds) if b > a))
    segments = tuple(
        Segment(round(a / LIVE_SAMPLE_RATE, 4), round(b / LIVE_SAMPLE_RATE, 4), _label_name(index, scene))
        for a, b, index in runs
    )
    return segments, tuple(index for *_, index in runs)


def through_opus(samples: FloatArray) -> FloatArray:
    """Encode and decode by the link's codec and remove its look-ahead, as the paper did with its training sound."""
    return encode_and_decode(samples, Codec("opus", channels=samples.shape[1], packet_size=480, bandwidth=20_000))


def _merged(runs: Iterable[tuple[int, int, int]]) -> Iterable[tuple[int, int, int]]:
    """Merge each run of ``(start, end, object)`` that is too short, or of the same object, into the one before it."""
    last: tuple[int, int, int] | None = None
    for start, end, index in runs:
        if last and (index == last[2] or end - start < SHORTEST * LIVE_SAMPLE_RATE):
            last = (last[0], end, last[2])
            continue
        if last:
            yield last
        last = (start, end, index)
    if last:
        yield last


def _label_name(index: int, scene: Scene) -> str:
    if index < 0:
        return "none"
    label = scene.objects[index].label
    return "contact" if label is Touch.NONE else label.name.lower()
