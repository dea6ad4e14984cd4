"""Layouts other than ``metadata.csv``: ``manifest.csv``, the paper's authors', lab
folders.

**The authors'** is ``opus/stereo/NN_variant.wav`` with channel 0 contact and 1 air, and
``finals_recordings/day_D_LABEL.wav``. Which objects are rough, and which are for
training, is in their notebooks (github.com/AIS-Bonn/Roughness_Sensing) and repeated
here. The tip is that of their finger, hard skin on a pad.

**A laboratory's folder** has no manifest, but labels and microphones in the names. A
part of a path may be a label (``rough/``), a microphone (``piezo/``, ``mems/``) or a
side of a split (``train/``); a file's name may end in a microphone (``x_contact.wav``
beside ``x_air.wav``). What is left names the surface and the take. Two mono files with
all else equal are a pair, which conversion joins into a file of two channels.
"""

import re
from collections import Counter, defaultdict
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

from tactophone.core.errors import DatasetError
from tactophone.core.microphones import MICROPHONES
from tactophone.core.tips import DEFAULT_TIP
from tactophone.core.types import SURFACE_LABELS, Touch
from tactophone.lab.dataset.checks import pair_fault
from tactophone.lab.dataset.metadata import PARTS, inside, parse_label, rows
from tactophone.lab.dataset.values import (
    LABEL_NAMES,
    Dataset,
    Problem,
    Recording,
    Segment,
    open_sound,
)

MANIFEST = "manifest.csv"
SEGMENTS = "segments.csv"

ROUGH_OBJECTS = frozenset({0, 1, 8, 11, 13, 15, 17, 19, 20, 22})
TEST_OBJECTS = frozenset({21, 22})
"""The paper has two, as the authors' test notebook; their training notebook leaves
object 20 out besides."""

SPARE_OBJECT = 20
"""Neither trained on nor tested with by default: the fine-tuned model's sample of the
competition's stones."""

KIN: Mapping[int, str] = {
    20: "competition rough",
    21: "competition smooth",
    22: "competition rough",
}
"""Objects that are the competition's stones: kin of its runs, which a split keeps on
one side."""

STEREO = Path("opus", "stereo")
FINALS = Path("finals_recordings")

TAKE_PRESSURES: Mapping[str, str] = {
    "light": "light",
    "medium": "medium",
    "loud": "strong",
}
"""The authors' name of each pressure, and the paper's."""

_OBJECT = re.compile(
    r"(?P<number>\d{2})_(?P<take>(?:(?P<stroke>long|short)_(?P<pressure>light|medium|loud))|wiggle)"
)
_FINAL = re.compile(r"day_(?P<day>\d)_(?P<label>smooth|rough)")
_COLUMNS = (
    "file",
    "surface",
    "label",
    "tier",
    "recording",
    "channels",
    "channel_meaning",
)


def read_manifest(folder: Path) -> Dataset:
    """Read a folder with ``manifest.csv`` and, where labels change in time,
    ``segments.csv``."""
    problems: list[Problem] = []
    segments = _segments(folder, problems)
    recordings = []
    for line, row in rows(folder / MANIFEST, required=("file", "surface", "label")):
        path = inside(folder, row["file"])
        if path is None:
            message = f"line {line}: file is {row['file']!r}, which is not a file in the folder; write its path"
            problems.append(Problem(folder / MANIFEST, "file", message))
            continue
        # A label such as "tap/no_contact (see segments.csv)" lists what the segments
        # hold.
        label = (
            ""
            if "segments" in row["label"]
            else parse_label(row["label"], path=path, problems=problems)
        )
        meanings = filter(None, row.get("channel_meaning", "").split(" | "))
        recordings.append(
            Recording(
                path,
                row["surface"],
                LABEL_NAMES[label],
                tuple(
                    "air" if meaning.strip().startswith("air") else "contact"
                    for meaning in meanings
                ),
                take=row.get("recording", ""),
                tier=row.get("tier", ""),
                segments=tuple(segments.get(row["file"], ())),
                properties={
                    key: value
                    for key, value in row.items()
                    if key not in _COLUMNS and value
                },
            )
        )
    return Dataset(folder.resolve().name, folder, tuple(recordings), tuple(problems))


def read_authors(folder: Path) -> Dataset:
    """Read the authors' layout; a file whose name does not fit is reported and left
    out."""
    problems: list[Problem] = []
    recordings = []
    for place, pattern, describe, wanted in (
        (
            STEREO,
            _OBJECT,
            _object,
            "layout has NN_variant.wav, variant wiggle or {long,short}_{light,medium,loud}",
        ),
        (
            FINALS,
            _FINAL,
            _final,
            "competition runs are named day_{1,2}_{smooth,rough}.wav",
        ),
    ):
        for path in sorted((folder / place).glob("*.wav")):
            if match := pattern.fullmatch(path.stem):
                recordings.append(describe(path, match))
            else:
                problems.append(
                    Problem(path, "name", f"the authors' {wanted}; rename it")
                )
    return Dataset(folder.resolve().name, folder, tuple(recordings), tuple(problems))


def _segments(folder: Path, problems: list[Problem]) -> dict[str, list[Segment]]:
    segments: dict[str, list[Segment]] = {}
    manifest = folder / SEGMENTS
    if not manifest.is_file():
        return segments
    for line, row in rows(manifest, required=("file", "start_s", "end_s", "label")):
        try:
            start, end = float(row["start_s"]), float(row["end_s"])
        except ValueError:
            message = f"line {line}: start_s and end_s are {row['start_s']!r} and {row['end_s']!r}; write seconds"
            problems.append(Problem(manifest, "segments", message, fatal=False))
            continue
        # A tap is a contact of unknown roughness.
        text = "contact" if row["label"] == "tap" else row["label"]
        label = parse_label(text, path=folder / row["file"], problems=problems)
        segments.setdefault(row["file"], []).append(Segment(start, end, label))
    return segments


def _object(path: Path, match: re.Match[str]) -> Recording:
    number = int(match["number"])
    properties = {
        "stroke": match["stroke"] or "wiggle",
        "pressure": TAKE_PRESSURES.get(match["pressure"] or "", ""),
        "split": "test"
        if number in TEST_OBJECTS
        else ""
        if number == SPARE_OBJECT
        else "train",
        "kin": KIN.get(number, f"object {number:02}"),
        "tip": DEFAULT_TIP,
    }
    label = Touch.ROUGH if number in ROUGH_OBJECTS else Touch.SMOOTH
    known = {key: value for key, value in properties.items() if value}
    return Recording(
        path,
        f"object {number:02}",
        label,
        MICROPHONES,
        take=match["take"],
        properties=known,
    )


def _final(path: Path, match: re.Match[str]) -> Recording:
    surface = f"competition {match['label']}"
    return Recording(
        path,
        surface,
        LABEL_NAMES[match["label"]],
        MICROPHONES,
        scenario="competition",
        session=f"day {match['day']}",
        properties={"split": "competition", "kin": surface, "tip": DEFAULT_TIP},
    )


SOUND_SUFFIXES = frozenset({".wav", ".flac", ".ogg", ".opus", ".mp3", ".aif", ".aiff"})

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
_TAKE_AT_END = re.compile(
    r"(?P<rest>.*?)[ _.-]*(?P<take>(?:long|short)_(?:light|medium|strong|loud)|wiggle|(?:take|rep|trial)?[ _.-]*\d+)",
    re.IGNORECASE,
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


def sounds_in(folder: Path) -> list[Path]:
    """Return the sound files at any depth of a folder, in order; none for a file."""
    return sorted(
        path for path in folder.rglob("*") if path.suffix.lower() in SOUND_SUFFIXES
    )


def read_lab_folder(folder: Path) -> LabFolder:
    """Find recordings, labels and pairs by the names below a folder.

    The folder is searched to any depth. Without a label in any name
    ``dataset.recordings`` is empty.

    A file without a label is named in the problems.
    """
    problems: list[Problem] = []
    groups: dict[Path, dict[str, tuple[Path, _Name]]] = defaultdict(dict)
    for path in sounds_in(folder):
        name = _parse_name(path.relative_to(folder))
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
        replace(recording, surface=f"{name.label} {name.surface}")
        if labels[name.surface] > 1
        else recording
        for recording, name, _ in entries
    )
    dataset = Dataset(folder.resolve().name, folder, recordings, tuple(problems))
    air_of = {recording.path: air for recording, _, air in entries if air}
    targets = {recording.path: name.key for recording, name, _ in entries}
    guessed = any(name.guessed for _, name, _ in entries)
    return LabFolder(dataset, air_of, targets, guessed)


def surface_and_take(stem: str) -> tuple[str, str]:
    """Split a file's name into surface and take: a number or one of the paper's takes
    at its end.

    >>> surface_and_take("granite_03"), surface_and_take("slate-long_light"), surface_and_take("07")
    (('granite', '03'), ('slate', 'long_light'), ('07', ''))
    """
    match = _TAKE_AT_END.fullmatch(stem)
    return (match["rest"], match["take"]) if match and match["rest"] else (stem, "")


def _parse_name(path: Path) -> _Name:
    label = microphone = side = ""
    others = []
    for part in path.parts[:-1]:
        word = part.lower()
        name = word.replace(" ", "_").replace("-", "_")
        if not label and word and name in LABEL_NAMES and word not in MICROPHONE_WORDS:
            label = name
        elif not microphone and word in MICROPHONE_WORDS:
            microphone = MICROPHONE_WORDS[word]
        elif not side and word in PARTS:
            side = word
        else:
            others.append(part)
    stem = path.stem
    if not microphone and (match := _MICROPHONE_AT_END.fullmatch(stem)):
        stem, microphone = match["rest"], MICROPHONE_WORDS[match["word"].lower()]
    surface, take = ("/".join(others), stem) if others else surface_and_take(stem)
    if not label:
        label = next(
            (
                word
                for word in re.split(r"[ _.\d-]", stem.lower())
                if LABEL_NAMES.get(word) in SURFACE_LABELS
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
            message = f"neither its name nor its folders hold a label; put it under {folders}/ or none/"
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
