"""Conversion of any known layout into ``metadata.csv``, and the data card."""

import dataclasses
from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import soundfile
from numpy.typing import NDArray

from tactophone.core.errors import DatasetError, plain
from tactophone.core.processes import atomic_write, is_other_file
from tactophone.core.recordings.links import name_below, refuse_foreign, refuse_link
from tactophone.core.recordings.metadata import (
    FILE_NAME,
    refuse_data_set,
    refuse_to_lose,
    write_metadata,
)
from tactophone.core.recordings.sound_file import (
    native_name,
    open_file,
    sound_info,
    text_name,
)
from tactophone.core.recordings.values import READ_SIZE, Dataset, Recording
from tactophone.core.types import SURFACE_LABELS, ignore

CARD = "README.md"
"""Where Hugging Face looks for the card of a data set."""


def convert(
    dataset: Dataset,
    out: Path,
    *,
    air_of: Mapping[Path, Path] = {},
    targets: Mapping[Path, Path] = {},
    progress: Callable[[int], None] = ignore,
) -> Dataset:
    """Copy recordings into a new folder as FLAC with a ``metadata.csv``; the originals
    stay.

    Sound is neither resampled nor mixed; floating-point sound becomes 24 bit. Both
    mappings are by a recording's path: ``air_of`` has the file of the air microphone
    where the recording holds the contact microphone alone, so that the copy has both;
    ``targets`` the path of the copy below ``out`` without suffix, by default as below
    the data set. ``progress`` is called with the number of recordings done. Raises
    `DatasetError` if ``out`` holds a data set already, or a file cannot be converted.
    """
    refuse_data_set(out)
    copies = []
    for done, recording in enumerate(dataset.recordings, 1):
        air = air_of.get(recording.path)
        for path in filter(None, (recording.path, air)):
            refuse_foreign(path, dataset.root)
        inner = targets.get(recording.path) or name_below(recording.path, dataset.root)
        # By hand, as `with_suffix` would take a dot within the name for one.
        stem = inner.name if recording.path in targets else inner.stem
        target = out / text_name(inner.parent / f"{stem}.flac")
        refuse_link(target.parent, out)
        copies.append(_copy(recording, target, air))
        progress(done)
    write_metadata(out, copies)
    return Dataset(out.name, out, tuple(copies))


def set_columns(dataset: Dataset, columns: Mapping[str, Mapping[str, str]]) -> Path:
    """Write columns of a data set's manifest, by surface; other surfaces keep theirs.

    Raises `DatasetError` if the data set has no ``metadata.csv`` of its own, or
    something in it is not understood and would be lost.
    """
    if not (dataset.root / FILE_NAME).is_file():
        raise DatasetError(
            f"{dataset.root}: no {FILE_NAME} to write to; `tactophone dataset import` "
            "makes one"
        )
    refuse_to_lose(dataset)
    changed = (
        recording.with_properties(**columns.get(recording.surface, {}))
        for recording in dataset.recordings
    )
    return write_metadata(dataset.root, changed)


def write_card(dataset: Dataset) -> Path:
    """Write a data card in Hugging Face's format: contents, how it was recorded, and
    known faults.

    Raises `DatasetError` where there is another one: what a person completed by hand,
    and names of numbered labels, would be lost.
    """
    target = dataset.root / CARD
    text = "\n".join(_card(dataset)) + "\n"
    if is_other_file(target, text.encode()):
        raise DatasetError(
            f"{target}: is there already, and may hold words of yours: move it away, "
            "and copy them from there into the new one"
        )
    with atomic_write(target) as unfinished:
        unfinished.write_text(text, encoding="utf-8")
    return target


def copy_as_flac(source: Path, target: Path, *, picked: Sequence[int] = ()) -> None:
    """Copy a sound file as FLAC, in 16 bits if it has 16, otherwise in 24; a kill
    leaves no half file at ``target``.

    ``picked`` are the places of the channels to copy; by default all are. Raises
    `OSError` or `soundfile.LibsndfileError` if the source cannot be read or the disk is
    full.
    """
    with open_file(source) as file:
        subtype = "PCM_16" if file.subtype == "PCM_16" else "PCM_24"
        # As integers, PCM is copied bit by bit.
        blocks = file.blocks(
            READ_SIZE,
            dtype="int32" if file.subtype.startswith("PCM") else "float32",
            always_2d=True,
        )
        places = list(picked) or list(range(file.channels))
        _write_flac(
            target,
            (samples[:, places] for samples in blocks),
            file.samplerate,
            len(places),
            subtype,
            size=len(file),
        )


def join_as_flac(contact: Path, air: Path, target: Path) -> None:
    """Write two mono files as one FLAC file, contact and air, as long as the shorter;
    errors as `copy_as_flac`."""
    with open_file(contact) as one, open_file(air) as two:
        size = min(len(one), len(two))
        # As integers, so that PCM stays bit by bit.
        pairs = zip(
            *(
                file.blocks(READ_SIZE, dtype="int32", frames=size)
                for file in (one, two)
            ),
            strict=True,
        )
        subtype = "PCM_16" if one.subtype == two.subtype == "PCM_16" else "PCM_24"
        _write_flac(
            target,
            (np.stack(pair, axis=1) for pair in pairs),
            one.samplerate,
            2,
            subtype,
            size=size,
        )


def _write_flac(
    target: Path,
    blocks: Iterable[NDArray[Any]],
    rate: int,
    channels: int,
    subtype: str,
    *,
    size: int,
) -> None:
    with atomic_write(target) as unfinished:
        with soundfile.SoundFile(
            native_name(unfinished), "w", rate, channels, subtype, format="FLAC"
        ) as flac:
            for samples in blocks:
                flac.write(samples)
        if sound_info(unfinished).size != size:
            raise OSError("the copy is shorter than the original")


def _copy(recording: Recording, target: Path, air: Path | None) -> Recording:
    target.parent.mkdir(parents=True, exist_ok=True)
    try:
        if air:
            join_as_flac(recording.path, air, target)
        else:
            copy_as_flac(recording.path, target, picked=recording.picked)
    except (soundfile.LibsndfileError, OSError) as error:
        step = (
            "free some space"
            if isinstance(error, OSError)
            else "`tactophone dataset check`"
        )  # of copy or source
        raise DatasetError(
            f"{recording.path}: cannot be converted ({error}); {step}"
        ) from None
    return dataclasses.replace(
        recording,
        path=target,
        channels=recording.microphones,
        surface=plain(recording.surface),
        take=plain(recording.take),
    )


def _card(dataset: Dataset) -> Iterator[str]:
    recordings = dataset.recordings
    yield from (
        "---",
        "pretty_name: " + dataset.name,
        "task_categories: [audio-classification]",
    )
    yield from (
        "tags: [tactile, haptics, texture, contact-microphone]",
        "---",
        "",
        f"# {dataset.name}",
        "",
    )
    paths = (recording.path for recording in recordings)
    infos = [
        sound_info(path) for path in paths if path.is_file() and path.stat().st_size
    ]
    minutes = sum(info.duration for info in infos) / 60
    rates = sorted({info.sample_rate for info in infos})
    channels = _join(" and ".join(recording.channels) for recording in recordings)
    yield (
        f"{len(recordings)} recordings of {len(dataset.surfaces)} surfaces, "
        f"{minutes:.1f} minutes, at "
        f"{', '.join(f'{rate} Hz' for rate in rates)}. Channels: {channels}."
    )
    yield from (
        "",
        f"SHA-256 over names, labels and bytes: `{dataset.fingerprint}`.",
        "",
    )
    yield f"Licence: {_values(recordings, 'licence', '; ')}."
    yield from (
        "",
        "## Surfaces",
        "",
        "| surface | label | material | scenarios | takes |",
        "|---|---|---|---|--:|",
    )
    for surface in dataset.surfaces:
        own = [recording for recording in recordings if recording.surface == surface]
        cells = (_values(own, key) for key in ("label", "material", "scenario"))
        yield f"| {surface} | {' | '.join(cells)} | {len(own)} |"
    yield from (
        "",
        "## How it was recorded",
        "",
        f"Takes: {_values(recordings, 'take')}.",
        "",
    )
    yield f"Sessions: {_values(recordings, 'session')}."
    yield f"Split: {_values(recordings, 'split')}."
    doubtful = [
        recording
        for recording in recordings
        if recording.known("quality") not in ("", "good")
    ]
    yield from ("", "## Known faults", "")
    yield from (
        f"- `{bad.path.relative_to(dataset.root)}`: {bad.known('quality')}"
        for bad in doubtful
    )
    yield from (f"- {problem.kind}: {problem.message}" for problem in dataset.problems)
    if not doubtful and not dataset.problems:
        yield "The recorder reported none; `tactophone dataset check` looks for more."
    counts = Counter(recording.label for recording in recordings)
    labels = ", ".join(
        f"{counts[label]} {label.name.lower()}" for label in reversed(SURFACE_LABELS)
    )
    yield from ("", "## Limits", "")
    yield (
        f"Each label is a person's label of a whole recording ({labels}), pauses "
        "between strokes included. Split by "
        "surface, never by window: windows overlap."
    )


def _values(recordings: Sequence[Recording], key: str, separator: str = ", ") -> str:
    return _join((recording.known(key) for recording in recordings), separator)


def _join(values: Iterable[str], separator: str = ", ") -> str:
    return separator.join(sorted(set(values) - {""})) or "not stated"
