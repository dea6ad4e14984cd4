"""Converts any known layout into the one of this project, and writes a data card beside it."""

import dataclasses
import os
from collections import Counter
from collections.abc import Callable, Iterator
from functools import partial
from pathlib import Path
from types import MappingProxyType

import soundfile

from tactophone.dataset.metadata import FILE_NAME, write_metadata
from tactophone.dataset.values import Dataset, Recording
from tactophone.errors import DatasetError
from tactophone.types import Touch

CARD = "README.md"
"""Where Hugging Face looks for a data set's card."""

READ_SIZE = 1 << 16


def convert(dataset: Dataset, out: Path, *, progress: Callable[[int], None] = lambda done: None) -> Dataset:
    """Copy recordings into a folder as FLAC, ``SURFACE/NAME.flac``, with a ``metadata.csv``; the originals stay.

    Sound is neither resampled nor mixed; floating-point sound becomes 24 bit.

    Raises
    ------
    DatasetError
        If a folder that holds a data set is given as ``out``, or a file cannot be converted.
    """
    if (out / FILE_NAME).exists():
        raise DatasetError(f"{out}: holds a data set already; name a new folder")
    made = []
    for done, recording in enumerate(dataset.recordings, 1):
        made.append(_copy(dataset, recording, out))
        progress(done)
    write_metadata(out, made)
    return Dataset(out.name, out, tuple(made))


def set_split(dataset: Dataset, sides: dict[str, str]) -> Path:
    """Write the column ``split`` of a data set's manifest.

    Parameters
    ----------
    sides
        ``train`` or ``test``, by surface.

    Raises
    ------
    DatasetError
        If the data set has no ``metadata.csv`` of its own.
    """
    if not (dataset.root / FILE_NAME).is_file():
        raise DatasetError(f"{dataset.root}: no {FILE_NAME} to write to; `tactophone dataset import` makes one")
    told = [
        dataclasses.replace(
            one, properties=MappingProxyType({**one.properties, "split": sides.get(one.surface, one.known("split"))})
        )
        for one in dataset.recordings
    ]
    return write_metadata(dataset.root, told)


def write_card(dataset: Dataset, *, path: Path | None = None) -> Path:
    """Write a data card in Hugging Face's form: what the set holds, how it was made, what is known to be wrong."""
    target = path or dataset.root / CARD
    target.write_text("\n".join(_card(dataset)) + "\n", encoding="utf-8")
    return target


def _copy(dataset: Dataset, recording: Recording, out: Path) -> Recording:
    target = (out / recording.path.resolve().relative_to(dataset.root.resolve())).with_suffix(".flac")
    target.parent.mkdir(parents=True, exist_ok=True)
    partial = target.with_suffix(".part.flac")
    try:
        with soundfile.SoundFile(recording.path) as source:
            subtype = "PCM_16" if source.subtype == "PCM_16" else "PCM_24"
            with soundfile.SoundFile(partial, "w", source.samplerate, source.channels, subtype) as flac:
                for samples in source.blocks(READ_SIZE, dtype="float32", always_2d=True):
                    flac.write(samples)
    except (soundfile.LibsndfileError, OSError) as error:
        partial.unlink(missing_ok=True)
        raise DatasetError(f"{recording.path}: cannot be converted ({error}); `tactophone dataset check`") from None
    os.replace(partial, target)
    return dataclasses.replace(recording, path=target)


def _card(dataset: Dataset) -> Iterator[str]:
    recordings = dataset.recordings
    licences = sorted({one.known("licence") for one in recordings} - {""})
    yield from ("---", "pretty_name: " + dataset.name, "task_categories: [audio-classification]")
    yield from ("tags: [tactile, haptics, texture, contact-microphone]", "---", "", f"# {dataset.name}", "")
    hours, rates = _sound(recordings)
    yield (
        f"{len(recordings)} recordings of {len(dataset.surfaces)} surfaces, {hours * 60:.1f} minutes, at "
        f"{', '.join(f'{rate} Hz' for rate in rates)}. Channels: {_listed(recordings, _channels)}."
    )
    yield from ("", f"SHA-256 over names, labels and bytes: `{dataset.fingerprint}`.", "")
    yield f"Licence: {'; '.join(licences) or 'not stated'}."
    yield from ("", "## Surfaces", "", "| surface | label | material | scenarios | takes |", "|---|---|---|---|--:|")
    for surface in dataset.surfaces:
        own = [one for one in recordings if one.surface == surface]
        words = [_listed(own, partial(_known, key)) for key in ("label", "material", "scenario")]
        yield f"| {surface} | {' | '.join(words)} | {len(own)} |"
    yield from ("", "## How it was made", "", f"Takes: {_listed(recordings, partial(_known, 'take'))}.", "")
    yield f"Sessions: {_listed(recordings, partial(_known, 'session'))}."
    yield f"Split: {_listed(recordings, partial(_known, 'split'))}."
    doubtful = [one for one in recordings if one.known("verdict") not in ("", "good")]
    yield from ("", "## Known faults", "")
    yield from (f"- `{one.path.relative_to(dataset.root)}`: {one.known('verdict')}" for one in doubtful)
    yield from (f"- {problem.kind}: {problem.message}" for problem in dataset.problems)
    if not doubtful and not dataset.problems:
        yield "None told by the recorder; `tactophone dataset check` looks for more."
    counted = Counter(one.label for one in recordings)
    yield from ("", "## Beware", "")
    yield (
        f"Labels are a person's word for a whole recording ({counted[Touch.ROUGH]} rough, {counted[Touch.SMOOTH]} "
        "smooth); pauses between strokes carry it too. Split by surface, never by window: windows overlap."
    )


def _sound(recordings: tuple[Recording, ...]) -> tuple[float, list[int]]:
    infos = [soundfile.info(one.path) for one in recordings if one.path.is_file() and one.path.stat().st_size]
    return sum(info.duration for info in infos) / 3600, sorted({int(info.samplerate) for info in infos})


def _channels(recording: Recording) -> str:
    return " and ".join(recording.channels)


def _known(key: str, recording: Recording) -> str:
    return recording.known(key)


def _listed(recordings: "tuple[Recording, ...] | list[Recording]", tell: Callable[[Recording], str]) -> str:
    return ", ".join(sorted({tell(one) for one in recordings} - {""})) or "not stated"
