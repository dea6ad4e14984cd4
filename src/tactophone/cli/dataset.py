"""``tactophone dataset``: show, check, split and convert data sets."""

import argparse
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from dataclasses import asdict
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import soundfile
from rich.table import Table

from tactophone.bridges import is_mcap
from tactophone.cli._support import terminal
from tactophone.cli._support.ranges import Within
from tactophone.dataset import (
    DEFAULT_CONTACT_DBFS,
    FILE_NAME,
    FORMATS,
    LABEL_NAMES,
    SPLITS,
    Dataset,
    Problem,
    Recording,
    check,
    check_consistency,
    convert,
    draw_dataset,
    find_importable,
    open_dataset,
    set_split,
    split,
    write_card,
)
from tactophone.errors import ConfigError
from tactophone.perception import Calibration

MOST_ALIKE = 5
"""Most warnings of one kind that are printed one by one."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the verb's actions and their arguments."""
    actions = parser.add_subparsers(title="actions", metavar="ACTION", required=True)

    def add(name: str, run: Callable[[argparse.Namespace], int], words: str) -> argparse.ArgumentParser:
        sub = actions.add_parser(name, help=words, description=words)
        sub.set_defaults(run=run)
        sub.add_argument("folder", metavar="DIR", help="a folder with metadata.csv, manifest.csv or opus/stereo/")
        return sub

    sub = add("check", _check, "read every file and report what is wrong; exit 1 if a recording cannot be used")
    sub.add_argument(
        "--calibration",
        type=Path,
        metavar="FILE",
        help=f"calibration with the contact threshold (default: {DEFAULT_CONTACT_DBFS:g} dBFS)",
    )
    _add_json(sub)
    sub = add("show", _show, "list surfaces, labels and recordings; with --plot, draw levels and spectrograms")
    sub.add_argument("--plot", type=Path, metavar="PNG", help="figure to write")
    _add_json(sub)
    sub = add("split", _split, "show the folds of a split; with --write, put train and test into the manifest")
    sub.add_argument("--by", default="4-fold", metavar="NAME", help=f"one of {', '.join(SPLITS)}")
    sub.add_argument(
        "--fold", type=Within(int, 1), default=1, metavar="N", help="the fold whose test set --write takes, %(type)s"
    )
    sub.add_argument("--write", action="store_true", help="write the column split of metadata.csv")
    _add_json(sub)
    sub = add(
        "import", _import,
        "convert another layout to this one, as FLAC: the paper's authors', manifest.csv, folders rough/ and smooth/, "
        "mono pairs piezo/x.wav and mems/x.wav or x_contact.wav and x_air.wav, file_name and label without surface, "
        "or an MCAP file of --record",
    )  # fmt: skip
    sub.add_argument("out", type=Path, metavar="OUT", help="new folder to write to")
    sub.add_argument(
        "--format", choices=FORMATS,
        help="of a published set: biotac (CSV files with pac1 to pac22), cluster (Cluster Haptic Texture Database), or "
        "sens3 (SENS3: a folder a surface, the sound of sliding)",
    )  # fmt: skip
    sub.add_argument("--surface", default="", metavar="NAME", help="of an MCAP file: the surface that was touched")
    sub.add_argument("--label", default="", metavar="LABEL", help="of an MCAP file: none, smooth or rough")
    add("card", _card, "write a data card, README.md, in Hugging Face's format")


def _add_json(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--json", action="store_true", help="print JSON instead of a table")


def _check(args: argparse.Namespace) -> int:
    dataset = open_dataset(args.folder)
    threshold_dbfs = Calibration.read(args.calibration).window_dbfs if args.calibration else DEFAULT_CONTACT_DBFS
    with terminal.progress("checking", 2 * len(dataset.recordings)) as update:
        single = check(dataset, progress=lambda done: update(completed=done))
        across = check_consistency(dataset, threshold_dbfs=threshold_dbfs, progress=lambda done: update(advance=1))
    problems = (*single, *across)
    bad = {problem.path for problem in problems if problem.fatal}
    if args.json:
        entries = [{**asdict(problem), "path": str(problem.path)} for problem in problems]
        terminal.print_json({"recordings": len(dataset.recordings), "problems": entries})
    else:
        for line in _lines(problems):
            print(line)
        found = f"{len(problems)} problem{'s' * (len(problems) != 1)}"
        print(f"{len(dataset.recordings)} recordings, {len(bad)} unusable, {found}")
    return 1 if bad else 0


def _lines(problems: Sequence[Problem]) -> Iterator[str]:
    """Yield a line for each problem; one for all warnings of a kind that many recordings share."""
    counts = Counter(problem.kind for problem in problems if not problem.fatal)
    for problem in problems:
        if problem.fatal or counts[problem.kind] <= MOST_ALIKE:
            yield f"{'error' if problem.fatal else 'warning'}: {problem}"
    for kind, count in counts.items():
        if count > MOST_ALIKE:
            first = next(problem for problem in problems if problem.kind == kind and not problem.fatal)
            yield f"warning: {count} times {kind!r}, such as {first}; --json lists all"


def _show(args: argparse.Namespace) -> int:
    dataset = open_dataset(args.folder)
    if args.plot:
        draw_dataset(args.plot, dataset)
    surfaces = _surfaces(dataset)
    if args.json:
        terminal.print_json({"name": dataset.name, "recordings": len(dataset.recordings), "surfaces": surfaces})
        return 0
    table = Table("surface", "label", "tier", "scenarios", "recordings", title=dataset.name, title_justify="left")
    for surface in surfaces:
        table.add_row(*(str(cell) for cell in surface.values()))
    terminal.out().print(table)
    if args.plot:
        terminal.out().print(args.plot, soft_wrap=True)
    return 0


def _split(args: argparse.Namespace) -> int:
    dataset = open_dataset(args.folder)
    folds = split(dataset, args.by)
    if args.write:
        if args.fold > len(folds):
            raise ConfigError(f"--fold {args.fold}: {args.by} has folds 1 to {len(folds)}")
        fold = folds[args.fold - 1]
        sides = {
            recording.surface: side
            for side, recordings in (("train", fold.train), ("test", fold.test))
            for recording in recordings
        }
        terminal.log().print(set_split(dataset, sides), soft_wrap=True)
    rows: list[dict[str, Any]] = [
        {"fold": fold.name, "train": len(fold.train), "test": sorted({recording.surface for recording in fold.test})}
        for fold in folds
    ]
    if args.json:
        terminal.print_json(rows)
        return 0
    table = Table("fold", "recordings to train on", "surfaces to test on", box=None)
    for row in rows:
        table.add_row(row["fold"], str(row["train"]), ", ".join(row["test"]))
    terminal.out().print(table)
    return 0


def _import_log(args: argparse.Namespace, log: Path) -> int:
    """Make a take of each session of a log, and of each finger of a hand."""
    from tactophone.offline.replay import write_sound

    if args.label not in LABEL_NAMES:
        raise ConfigError(f"--label {args.label}: must be one of {', '.join(filter(None, LABEL_NAMES))}")
    with TemporaryDirectory(prefix="tactophone-") as folder:
        takes = [
            Recording(
                sound.path, args.surface or log.stem, LABEL_NAMES[args.label],
                ("contact", "air")[: soundfile.info(sound.path).channels],
                take="-".join(filter(None, (str(sound.session), sound.finger))), session=log.stem,
            )
            for sound in write_sound(log, Path(folder))
        ]  # fmt: skip
        converted = convert(Dataset(log.stem, Path(folder), tuple(takes)), args.out)
    _print_count(len(converted.recordings), args.out)
    return 0


def _import(args: argparse.Namespace) -> int:
    if is_mcap(Path(args.folder)):
        return _import_log(args, Path(args.folder))
    if args.format:
        return _import_published(args)
    found = find_importable(args.folder)
    for problem in found.dataset.problems:
        terminal.note(f"{'left out' if problem.fatal else 'warning'}: {problem}")
    with terminal.progress("converting", len(found.dataset.recordings)) as update:
        converted = convert(
            found.dataset, args.out, air_of=found.air_of, targets=found.targets,
            progress=lambda done: update(completed=done),
        )  # fmt: skip
    pairs = f", {len(found.air_of)} of them joined from two mono files" if found.air_of else ""
    print(f"{len(converted.recordings)} recordings{pairs} in {args.out}")
    if found.guessed:
        surfaces = converted.surfaces
        shown = ", ".join(surfaces[:6]) + (", ..." if len(surfaces) > 6 else "")
        terminal.note(
            f"beware: {len(surfaces)} surfaces were taken from file names: {shown}; correct the column surface of "
            f"{args.out / FILE_NAME} where two names are one surface, as splits keep a surface on one side"
        )
    return 0


def _import_published(args: argparse.Namespace) -> int:
    with terminal.progress("converting") as update:
        made, problems = FORMATS[args.format](Path(args.folder), args.out, progress=lambda done: update(completed=done))
    for problem in problems:
        terminal.note(f"left out: {problem}")
    _print_count(len(made.recordings), args.out)
    if not any(recording.label is not None for recording in made.recordings):
        terminal.log().print("beware: no labels; add labels.csv with the columns surface and label to the folder")
    return 0


def _card(args: argparse.Namespace) -> int:
    print(write_card(open_dataset(args.folder)))
    return 0


def _surfaces(dataset: Dataset) -> list[dict[str, Any]]:
    """Return a row for each surface: its name, the values of three columns, and its number of recordings."""
    values: dict[str, dict[str, set[str]]] = {}
    for recording in dataset.recordings:
        columns = values.setdefault(recording.surface, {"label": set(), "tier": set(), "scenario": set()})
        for key, column in columns.items():
            column.add(recording.known(key) or "-")
    counts = Counter(recording.surface for recording in dataset.recordings)
    return [
        {
            "surface": surface,
            **{key: ", ".join(sorted(column)) for key, column in values[surface].items()},
            "recordings": counts[surface],
        }
        for surface in dataset.surfaces
    ]


def _print_count(recordings: int, folder: Path) -> None:
    print(f"{recordings} recording{'s' * (recordings != 1)} in {folder}")
