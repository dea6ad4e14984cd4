"""Folders without a manifest, whose names say what was recorded: ``rough/stone_1.wav``.

A folder or a file's name holds the label; the rest of the name is surface and take, and
a word such as *contact* or *air* tells the microphones apart, each in a file of its
own.
"""

import re
from collections import Counter, defaultdict
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

from tactophone.core.errors import DatasetError
from tactophone.core.microphones import MICROPHONES
from tactophone.core.recordings.label_tracks import (
    label_of,
    read_events,
    read_selections,
    read_track,
)
from tactophone.core.recordings.layouts import sounds_in, surface_and_take
from tactophone.core.recordings.links import link_fault
from tactophone.core.recordings.metadata import PARTS
from tactophone.core.recordings.values import (
    LABEL_NAMES,
    Dataset,
    Problem,
    Recording,
    open_sound,
)
from tactophone.core.types import SURFACE_LABELS
from tactophone_lab.datasets.checks import pair_fault

MICROPHONE_WORDS: Mapping[str, str] = {
    "contact": "contact",
    "piezo": "contact",
    "air": "air",
    "mems": "air",
    "mic": "air",
    "microphone": "air",
}
"""Words for a microphone in the names of folders and files, and the channel that each
is."""

_MICROPHONE_AT_END = re.compile(
    rf"(?P<rest>.+)[ _.-](?P<word>{'|'.join(MICROPHONE_WORDS)})", re.IGNORECASE
)


@dataclass(frozen=True, slots=True)
class LabFolder:
    """What was found in a folder without a manifest."""

    dataset: Dataset
    """A recording for each file or pair; of a pair, ``path`` is the contact file.
    ``problems`` has the rest."""
    air_of: Mapping[Path, Path] = field(default_factory=dict)
    """The air file of each pair, by its contact file."""
    targets: Mapping[Path, Path] = field(default_factory=dict)
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

    def recording(self, path: Path, channels: tuple[str, ...]) -> Recording:
        properties = {"split": self.side} if self.side else {}
        return Recording(
            path,
            self.surface,
            LABEL_NAMES[self.label],
            channels,
            take=self.take,
            properties=properties,
        )


def read_lab_folder(
    folder: Path,
    *,
    follow_links: bool = False,
    words: Mapping[str, str] | None = None,
) -> LabFolder:
    """Find recordings, labels and pairs by the names below a folder; ``follow_links``
    as for `read_metadata`.

    ``words`` says which label a folder's own name stands for: ``{"rau": "rough"}``.

    The folder is searched to any depth. Without a label in any name
    ``dataset.recordings`` is empty.

    A file without a label is named in the problems.
    """
    for word, label in (words or {}).items():
        if label not in LABEL_NAMES:
            raise DatasetError(
                f"{word}={label}: a label is one of "
                f"{', '.join(filter(None, LABEL_NAMES))}"
            )
    own = {word.lower(): label for word, label in (words or {}).items()}
    problems: list[Problem] = []
    groups: dict[Path, dict[str, tuple[Path, _Name]]] = defaultdict(dict)
    sounds = sounds_in(folder)
    timed = {
        **read_events(folder, sounds, problems, follow_links=follow_links),
        **read_selections(folder, sounds, problems, follow_links=follow_links),
    }
    for path in sounds:
        if fault := link_fault(path, folder, follow=follow_links):
            problems.append(Problem(path, "link", fault))
            continue
        if path not in timed:
            timed[path] = read_track(path, folder, problems, follow_links=follow_links)
        name = _parse_name(path.relative_to(folder), own)
        if timed[path] and not name.label:
            name = replace(name, label=label_of(timed[path]))
        if name.microphone in groups[name.key]:
            first = groups[name.key][name.microphone][0].relative_to(folder)
            problems.append(
                Problem(path, "name", f"reads the same as {first}; rename either file")
            )
            continue
        groups[name.key][name.microphone] = path, name
    entries = list(_recordings(groups, problems))
    # A surface under two labels is two surfaces: each gets its label in front.
    labels = Counter(
        surface
        for surface, _ in {
            (recording.surface, name.label) for recording, name, _ in entries
        }
    )
    recordings = tuple(
        replace(
            recording,
            surface=f"{name.label} {name.surface}"
            if labels[name.surface] > 1
            else name.surface,
            segments=timed[recording.path],
        )
        for recording, name, _ in entries
    )
    dataset = Dataset(folder.resolve().name, folder, recordings, tuple(problems))
    air_of = {recording.path: air for recording, _, air in entries if air}
    targets = {recording.path: name.key for recording, name, _ in entries}
    guessed = any(name.guessed for _, name, _ in entries)
    return LabFolder(dataset, air_of, targets, guessed)


def _parse_name(path: Path, own: Mapping[str, str]) -> _Name:
    label = microphone = side = ""
    others = []
    for part in path.parts[:-1]:
        word = part.lower()
        name = word.replace(" ", "_").replace("-", "_")
        if not label and word in own:
            label = own[word]
        elif (
            not label and word and name in LABEL_NAMES and word not in MICROPHONE_WORDS
        ):
            label = name
        elif not microphone and word in MICROPHONE_WORDS:
            microphone = MICROPHONE_WORDS[word]
        elif not side and word in PARTS:
            side = word
        else:
            others.append(part)
    stem = path.stem
    if not microphone and (match := _MICROPHONE_AT_END.fullmatch(stem)):
        stem = match["rest"]
        microphone = MICROPHONE_WORDS[match["word"].lower()]
    surface, take = ("/".join(others), stem) if others else surface_and_take(stem)
    if not label:
        label = next(
            (
                label
                for word in re.split(r"[ _.\d-]", stem.lower())
                if LABEL_NAMES.get(label := own.get(word, word)) in SURFACE_LABELS
            ),
            "",
        )
    key = Path(*filter(None, (side, label)), *others, stem)
    return _Name(key, label, microphone, side, surface, take, guessed=not others)


def _recordings(
    groups: Mapping[Path, Mapping[str, tuple[Path, _Name]]], problems: list[Problem]
) -> Iterator[tuple[Recording, _Name, Path | None]]:
    """Yield each recording with what its name says and, of a pair, its air file."""
    for files in groups.values():
        path, name = files.get("contact") or next(iter(files.values()))
        if not name.label:
            folders = "/, ".join(
                label.name.lower() for label in reversed(SURFACE_LABELS)
            )
            message = (
                "neither its name nor its folders hold a label; put it under "
                f"{folders}/ or none/"
            )
            problems.extend(
                Problem(each, "label", message) for each, _ in files.values()
            )
            continue
        if "contact" in files and "air" in files:
            air = files["air"][0]
            message, fatal = pair_fault(path, air)
            if message:
                problems.append(Problem(path, "pair", message, fatal))
            if not fatal:
                yield name.recording(path, MICROPHONES), name, air
            continue
        for each, its_name in files.values():
            yield (
                its_name.recording(each, _channels_named(each, its_name.microphone)),
                its_name,
                None,
            )


def _channels_named(path: Path, microphone: str) -> tuple[str, ...]:
    """Channels of a single file: what its name says, if it holds as many; unknown
    otherwise."""
    if not microphone:
        return ()
    try:
        with open_sound(path) as file:
            return (microphone,) if file.channels == 1 else ()
    except DatasetError:
        return ()
