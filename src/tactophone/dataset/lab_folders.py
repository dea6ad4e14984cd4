"""Folders of recordings as laboratories keep them, without a manifest: labels and microphones in the names.

A part of a path may be a label (``rough/``), a microphone (``piezo/``, ``mems/``) or a side of a split (``train/``); a
file's name may end in a microphone (``x_contact.wav`` beside ``x_air.wav``). What is left names the surface and the
take. Two mono files with all else equal are a pair, which conversion joins into a file of two channels.
"""

import re
from collections import Counter, defaultdict
from collections.abc import Iterable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import MappingProxyType

import soundfile

from tactophone.dataset.metadata import PARTS
from tactophone.dataset.mono_pairs import pair_fault
from tactophone.dataset.values import LABEL_NAMES, TWO_CHANNELS, Dataset, Problem, Recording

SOUND_SUFFIXES = frozenset({".wav", ".flac", ".ogg", ".opus", ".mp3", ".aif", ".aiff"})

MICROPHONES: Mapping[str, str] = MappingProxyType(
    {"contact": "contact", "piezo": "contact", "air": "air", "mems": "air", "mic": "air", "microphone": "air"}
)
"""Words for a microphone in the names of folders and files, and the channel that each is."""

_MICROPHONE_AT_END = re.compile(rf"(?P<rest>.+)[ _.-](?P<word>{'|'.join(MICROPHONES)})", re.IGNORECASE)
_TAKE_AT_END = re.compile(
    r"(?P<rest>.*?)[ _.-]*(?P<take>(?:long|short)_(?:light|medium|strong|loud)|wiggle|(?:take|rep|trial)?[ _.-]*\d+)",
    re.IGNORECASE,
)


@dataclass(frozen=True, slots=True)
class LabFolder:
    """What was found in a folder without a manifest."""

    dataset: Dataset
    """A recording for each file or pair; of a pair, ``path`` is the contact file. ``problems`` has the rest."""
    air_of: Mapping[Path, Path] = field(default_factory=lambda: MappingProxyType({}))
    """The air file of each pair, by its contact file."""
    targets: Mapping[Path, Path] = field(default_factory=lambda: MappingProxyType({}))
    """Path of each copy below the new folder, by ``path``, without a suffix."""
    guessed: bool = False
    """True where surfaces were taken from file names, which a person should look at."""


@dataclass(frozen=True, slots=True)
class _Name:
    """What the path of a file says; ``key`` is the same for the two files of a pair."""

    key: Path
    label: str
    microphone: str
    side: str
    surface: str
    take: str
    guessed: bool


def read_lab_folder(folder: Path) -> LabFolder:
    """Find recordings, labels and pairs by the names below a folder.

    The folder is searched to any depth. Without a label in any name ``dataset.recordings`` is empty.

    A file without a label is named in the problems.
    """
    problems: list[Problem] = []
    groups: dict[Path, dict[str, tuple[Path, _Name]]] = defaultdict(dict)
    for path in sorted(path for path in folder.rglob("*") if path.suffix.lower() in SOUND_SUFFIXES):
        name = _parse(path.relative_to(folder))
        if name.microphone in groups[name.key]:
            first = groups[name.key][name.microphone][0].relative_to(folder)
            problems.append(Problem(path, "name", f"reads the same as {first}; rename either file"))
            continue
        groups[name.key][name.microphone] = path, name
    entries = list(_recordings(groups, problems))
    names = _surface_names(entries)
    recordings = tuple(replace(recording, surface=names[recording.path]) for recording, _, _ in entries)
    dataset = Dataset(folder.resolve().name, folder, recordings, tuple(problems))
    air_of = {recording.path: air for recording, _, air in entries if air}
    targets = {recording.path: name.key for recording, name, _ in entries}
    guessed = any(name.guessed for _, name, _ in entries)
    return LabFolder(dataset, MappingProxyType(air_of), MappingProxyType(targets), guessed)


def surface_and_take(stem: str) -> tuple[str, str]:
    """Split a file's name into surface and take: a number or one of the paper's takes at its end.

    >>> surface_and_take("granite_03"), surface_and_take("slate-long_light"), surface_and_take("07")
    (('granite', '03'), ('slate', 'long_light'), ('07', ''))
    """
    match = _TAKE_AT_END.fullmatch(stem)
    return (match["rest"], match["take"]) if match and match["rest"] else (stem, "")


def _parse(path: Path) -> _Name:
    label = microphone = side = ""
    others = []
    for part in path.parts[:-1]:
        word = part.lower()
        if not label and _is_label(word):
            label = word.replace(" ", "_").replace("-", "_")
        elif not microphone and word in MICROPHONES:
            microphone = MICROPHONES[word]
        elif not side and word in PARTS:
            side = word
        else:
            others.append(part)
    stem = path.stem
    if not microphone and (match := _MICROPHONE_AT_END.fullmatch(stem)):
        stem, microphone = match["rest"], MICROPHONES[match["word"].lower()]
    surface, take = surface_and_take(stem)
    if not label:
        label = next((word for word in re.split(r"[ _.\d-]", stem.lower()) if word in ("rough", "smooth")), "")
    key = Path(*filter(None, (side, label)), *others, stem)
    if others:
        return _Name(key, label, microphone, side, "/".join(others), stem, False)
    return _Name(key, label, microphone, side, surface, take, True)


def _is_label(word: str) -> bool:
    return bool(word) and word.replace(" ", "_").replace("-", "_") in LABEL_NAMES and word not in MICROPHONES


def _recordings(
    groups: Mapping[Path, Mapping[str, tuple[Path, _Name]]], problems: list[Problem]
) -> Iterator[tuple[Recording, _Name, Path | None]]:
    """Yield each recording with what its name says and, of a pair, its air file."""
    for files in groups.values():
        path, name = files.get("contact") or next(iter(files.values()))
        if not name.label:
            message = "neither its name nor its folders hold a label; put it under rough/, smooth/ or none/"
            problems.extend(Problem(each, "label", message) for each, _ in files.values())
            continue
        if "contact" in files and "air" in files:
            air = files["air"][0]
            fault = pair_fault(path, air)
            if fault:
                problems.append(Problem(path, "pair", fault.message, fault.fatal))
            if not (fault and fault.fatal):
                yield _recording(path, name, TWO_CHANNELS), name, air
            continue
        for each, its_name in files.values():
            yield _recording(each, its_name, _channels(each, its_name.microphone)), its_name, None


def _recording(path: Path, name: _Name, channels: tuple[str, ...]) -> Recording:
    properties = {"split": name.side} if name.side else {}
    return Recording(
        path, name.surface, LABEL_NAMES[name.label], channels, take=name.take, properties=MappingProxyType(properties)
    )


def _channels(path: Path, microphone: str) -> tuple[str, ...]:
    """Channels of a single file: what its name says, if it holds as many; unknown otherwise."""
    if not microphone:
        return ()
    try:
        return (microphone,) if soundfile.info(path).channels == 1 else ()
    except (soundfile.LibsndfileError, OSError):
        return ()


def _surface_names(entries: Iterable[tuple[Recording, _Name, Path | None]]) -> dict[Path, str]:
    """Name each recording's surface; a name under two labels gets the label in front."""
    entries = list(entries)
    labels = Counter(surface for surface, _ in {(recording.surface, name.label) for recording, name, _ in entries})
    return {
        recording.path: f"{name.label} {recording.surface}" if labels[recording.surface] > 1 else recording.surface
        for recording, name, _ in entries
    }
