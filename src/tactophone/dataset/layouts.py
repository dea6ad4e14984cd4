"""Other layouts: folders with ``manifest.csv``, and the published recordings of the paper's authors.

The authors' layout is ``opus/stereo/NN_variant.wav`` with channel 0 contact and 1 air, and
``finals_recordings/day_D_LABEL.wav``. Which objects are rough, and which are for training, is in their notebooks
(github.com/AIS-Bonn/Roughness_Sensing) and repeated here. The tip is that of their finger, hard skin on a pad.
"""

import re
from collections.abc import Iterator, Mapping
from pathlib import Path
from types import MappingProxyType

from tactophone.dataset.metadata import inside, parse_label, rows
from tactophone.dataset.values import LABEL_NAMES, Dataset, Problem, Recording, Segment
from tactophone.types import DEFAULT_TIP, Touch

MANIFEST = "manifest.csv"
SEGMENTS = "segments.csv"

ROUGH_OBJECTS = frozenset({0, 1, 8, 11, 13, 15, 17, 19, 20, 22})
TEST_OBJECTS = frozenset({21, 22})
"""The paper has two, as the authors' test notebook; their training notebook leaves object 20 out besides."""

SPARE_OBJECT = 20
"""Neither trained on nor tested with by default: the fine-tuned model's sample of the competition's stones."""

KIN: Mapping[int, str] = MappingProxyType({20: "competition rough", 21: "competition smooth", 22: "competition rough"})
"""Objects that are the competition's stones: kin of its runs, which a split keeps on one side."""

REDUCED_OBJECTS = frozenset(range(10, 20))
"""Training objects of the fine-tuned model: the paper says *fewer objects* and does not name them. These are the casts,
which are most like the competition's stones."""

STEREO = Path("opus", "stereo")
FINALS = Path("finals_recordings")

PRESSURES: Mapping[str, str] = MappingProxyType({"light": "light", "medium": "medium", "loud": "strong"})
"""The authors' name of each pressure, and the paper's."""

_OBJECT = re.compile(r"(?P<number>\d{2})_(?P<take>(?:(?P<stroke>long|short)_(?P<pressure>light|medium|loud))|wiggle)")
_FINAL = re.compile(r"day_(?P<day>\d)_(?P<label>smooth|rough)")
_COLUMNS = ("file", "surface", "label", "tier", "recording", "channels", "channel_meaning")


def holds_manifest(folder: Path) -> bool:
    """Return whether a folder has a ``manifest.csv``."""
    return (folder / MANIFEST).is_file()


def read_manifest(folder: Path) -> Dataset:
    """Read a folder with ``manifest.csv`` and, where labels change in time, ``segments.csv``."""
    problems: list[Problem] = []
    segments = _segments(folder, problems)
    recordings = []
    for line, row in rows(folder / MANIFEST, required=("file", "surface", "label")):
        path = inside(folder, row["file"])
        if path is None:
            message = f"line {line}: file is {row['file']!r}, which is not a file in the folder; write its path"
            problems.append(Problem(folder / MANIFEST, "file", message))
            continue
        recordings.append(_manifest_recording(row, path, segments=segments, problems=problems))
    return Dataset(folder.resolve().name, folder, tuple(recordings), tuple(problems))


def holds_authors(folder: Path) -> bool:
    """Return whether a folder has the authors' layout."""
    return (folder / STEREO).is_dir() or (folder / FINALS).is_dir()


def read_authors(folder: Path) -> Dataset:
    """Read the authors' layout; a file whose name does not fit is reported and left out."""
    problems: list[Problem] = []
    recordings = [
        recording
        for place, parse in ((STEREO, _object), (FINALS, _final))
        for path in sorted((folder / place).glob("*.wav"))
        if (recording := parse(path, problems))
    ]
    return Dataset(folder.resolve().name, folder, tuple(recordings), tuple(problems))


def _manifest_recording(
    row: Mapping[str, str], path: Path, *, segments: Mapping[str, list[Segment]], problems: list[Problem]
) -> Recording:
    # A label such as "tap/no_contact (see segments.csv)" lists what the segments hold.
    label = None if "segments" in row["label"] else LABEL_NAMES[parse_label(row["label"], path=path, problems=problems)]
    return Recording(
        path,
        row["surface"],
        label,
        tuple(_channels(row.get("channel_meaning", ""))),
        take=row.get("recording", ""),
        tier=row.get("tier", ""),
        segments=tuple(segments.get(row["file"], ())),
        properties=MappingProxyType({key: value for key, value in row.items() if key not in _COLUMNS and value}),
    )


def _channels(meaning: str) -> Iterator[str]:
    for part in filter(None, meaning.split(" | ")):
        yield "air" if part.strip().startswith("air") else "contact"


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


def _object(path: Path, problems: list[Problem]) -> Recording | None:
    match = _OBJECT.fullmatch(path.stem)
    if not match:
        message = (
            "the authors' layout has NN_variant.wav, variant wiggle or {long,short}_{light,medium,loud}; rename it"
        )
        problems.append(Problem(path, "name", message))
        return None
    number = int(match["number"])
    properties = {
        "stroke": match["stroke"] or "wiggle",
        "pressure": PRESSURES.get(match["pressure"] or "", ""),
        "split": "test" if number in TEST_OBJECTS else "" if number == SPARE_OBJECT else "train",
        "kin": KIN.get(number, f"object {number:02}"),
        "tip": DEFAULT_TIP,
    }
    return Recording(
        path,
        f"object {number:02}",
        Touch.ROUGH if number in ROUGH_OBJECTS else Touch.SMOOTH,
        ("contact", "air"),
        take=match["take"],
        properties=MappingProxyType({key: value for key, value in properties.items() if value}),
    )


def _final(path: Path, problems: list[Problem]) -> Recording | None:
    match = _FINAL.fullmatch(path.stem)
    if not match:
        message = "the authors' competition runs are named day_{1,2}_{smooth,rough}.wav; rename it"
        problems.append(Problem(path, "name", message))
        return None
    return Recording(
        path,
        f"competition {match['label']}",
        LABEL_NAMES[match["label"]],
        ("contact", "air"),
        scenario="competition",
        session=f"day {match['day']}",
        properties=MappingProxyType(
            {"split": "competition", "kin": f"competition {match['label']}", "tip": DEFAULT_TIP}
        ),
    )
