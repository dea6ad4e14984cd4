"""Layouts other than ``metadata.csv``: ``manifest.csv``, and the paper's authors'.

**The authors'** is ``opus/stereo/NN_variant.wav`` with channel 0 contact and 1 air, and
``finals_recordings/day_D_LABEL.wav``. Which objects are rough, and which are for
training, is in their notebooks (github.com/AIS-Bonn/Roughness_Sensing) and repeated
here. The tip is their finger's, hard skin on a pad.
"""

import re
from collections.abc import Mapping
from pathlib import Path

from tactophone.core.microphones import MICROPHONES
from tactophone.core.recordings.links import link_fault, refuse_to_read
from tactophone.core.recordings.metadata import named_file, parse_label, rows
from tactophone.core.recordings.sound_file import SOUND_SUFFIXES, is_hidden
from tactophone.core.recordings.values import (
    LABEL_NAMES,
    Dataset,
    Problem,
    Recording,
    Segment,
)
from tactophone.core.tips import DEFAULT_TIP
from tactophone.core.types import Touch

MANIFEST = "manifest.csv"
"""Name of the table of recordings."""

SEGMENTS = "segments.csv"
"""Name of the table of labels that change in time."""

ROUGH_OBJECTS = frozenset({0, 1, 8, 11, 13, 15, 17, 19, 20, 22})
"""Objects that the authors' notebooks label rough; all others are smooth."""

TEST_OBJECTS = frozenset({21, 22})
"""Objects to test with: two in the paper, as in the authors' test notebook. Their
training notebook also leaves out object 20."""

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
"""The authors' folder of recordings of objects."""

SAMPLE = "sample"
"""Session of a sample of the competition's stones."""

FINALS = Path("finals_recordings")
"""The authors' folder of recordings at the competition."""

TAKE_PRESSURES: Mapping[str, str] = {
    "light": "light",
    "medium": "medium",
    "loud": "strong",
}
"""The authors' name of each pressure, and the paper's."""

_OBJECT = re.compile(
    r"(?P<number>\d{2})_(?P<take>(?:(?P<stroke>long|short)_(?P<pressure>light|medium|loud))|wiggle)"
)
_FINAL = re.compile(r"(?:day_(?P<day>\d)|sample)_(?P<label>smooth|rough)")
"""A day's run, or a sample of the competition's stones, which the fine-tuned model may
train on. The authors' own data have no file of that name; simulated ones do."""
_COLUMNS = (
    "file",
    "surface",
    "label",
    "tier",
    "recording",
    "channels",
    "channel_meaning",
)


def read_manifest(folder: Path, *, follow_links: bool = False) -> Dataset:
    """Read a folder with ``manifest.csv`` and, where labels change in time,
    ``segments.csv``; ``follow_links`` as for `read_metadata`."""
    problems: list[Problem] = []
    for table in (MANIFEST, SEGMENTS):
        refuse_to_read(folder / table, folder, follow=follow_links)
    segments = _segments(folder, problems)
    recordings = []
    for line, row in rows(folder / MANIFEST, required=("file", "surface", "label")):
        path = named_file(
            folder,
            row["file"],
            manifest=folder / MANIFEST,
            line=line,
            problems=problems,
            follow_links=follow_links,
        )
        if path is None:
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


def read_authors(folder: Path, *, follow_links: bool = False) -> Dataset:
    """Read the authors' layout; a file whose name does not fit is reported and left
    out. ``follow_links`` as for `read_metadata`."""
    problems: list[Problem] = []
    recordings = []
    for place, pattern, describe, wanted in (
        (
            STEREO,
            _OBJECT,
            _object,
            "layout has NN_variant.wav, variant wiggle or "
            "{long,short}_{light,medium,loud}",
        ),
        (
            FINALS,
            _FINAL,
            _final,
            "competition runs are named day_{1,2}_{smooth,rough}.wav",
        ),
    ):
        for path in sorted((folder / place).glob("[!.]*.wav")):
            if fault := link_fault(path, folder, follow=follow_links):
                problems.append(Problem(path, "link", fault))
            elif match := pattern.fullmatch(path.stem):
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
            start = float(row["start_s"])
            end = float(row["end_s"])
        except ValueError:
            message = (
                f"line {line}: start_s and end_s are {row['start_s']!r} and "
                f"{row['end_s']!r}; write seconds"
            )
            problems.append(Problem(manifest, "segments", message, fatal=False))
            continue
        # A tap is a contact of unknown roughness.
        text = "contact" if row["label"] == "tap" else row["label"]
        label = parse_label(text, path=folder / row["file"], problems=problems)
        segments.setdefault(row["file"], []).append(Segment(start, end, label))
    return segments


def _object(path: Path, match: re.Match[str]) -> Recording:
    number = int(match["number"])
    split = "" if number == SPARE_OBJECT else "train"
    if number in TEST_OBJECTS:
        split = "test"
    properties = {
        "stroke": match["stroke"] or "wiggle",
        "pressure": TAKE_PRESSURES.get(match["pressure"] or "", ""),
        "split": split,
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
    day = match["day"]
    properties = {"kin": surface, "tip": DEFAULT_TIP}
    return Recording(
        path,
        surface,
        LABEL_NAMES[match["label"]],
        MICROPHONES,
        scenario="competition",
        session=f"day {day}" if day else SAMPLE,
        properties={"split": "competition", **properties} if day else properties,
    )


_TAKE_AT_END = re.compile(
    r"(?<![ _.-])(?!(?<=\d)\d)[ _.-]*+"
    r"(?P<take>(?:long|short)_(?:light|medium|strong|loud)|wiggle|"
    r"(?:take|rep|trial)?[ _.-]*+\d++)\Z",
    re.IGNORECASE,
)
"""It begins neither within separators nor within digits, and gives none of them back: a
stranger's name of 100,000 underscores would otherwise take hours."""


def sounds_in(folder: Path) -> list[Path]:
    """Return the sound files at any depth of a folder, in order, without what the
    system hides; none for a file."""
    return sorted(
        path
        for path in folder.rglob("*")
        if path.suffix.lower() in SOUND_SUFFIXES and not is_hidden(path, folder)
    )


def surface_and_take(stem: str) -> tuple[str, str]:
    """Split a file's name into surface and take: a number or one of the paper's takes
    at its end.

    >>> surface_and_take("granite_03"), surface_and_take("slate-long_light")
    (('granite', '03'), ('slate', 'long_light'))
    >>> surface_and_take("07")
    ('07', '')
    """
    match = _TAKE_AT_END.search(stem)
    return (
        (stem[: match.start()], match["take"])
        if match and match.start()
        else (stem, "")
    )
