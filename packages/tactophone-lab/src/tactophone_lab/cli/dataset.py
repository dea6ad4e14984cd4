"""``tactophone dataset``: show, check, split and convert data sets."""

import argparse
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import soundfile

from tactophone.app.figures import draw_dataset
from tactophone.cli import options, output
from tactophone.cli.options import Within
from tactophone.core.errors import ConfigError
from tactophone.core.microphones import MICROPHONES
from tactophone.core.recordings.label_tracks import (
    segments_of,
    write_events,
    write_tracks,
)
from tactophone.core.recordings.metadata import FILE_NAME
from tactophone.core.recordings.sound_file import sound_info
from tactophone.core.recordings.values import LABEL_NAMES, Dataset, Problem, Recording
from tactophone.live.log.mcap import is_mcap
from tactophone.signal.perception.calibration import Calibration
from tactophone_lab.cli.data import (
    add_follow_links,
    add_labels,
    open_as,
    reading_of,
    report_left_out,
)
from tactophone_lab.datasets.checks import (
    DEFAULT_CONTACT_DBFS,
    check,
    check_consistency,
    nothing_usable,
    usable,
    with_picked_channels,
)
from tactophone_lab.datasets.convert import convert, set_columns, write_card
from tactophone_lab.datasets.open import find_importable, open_dataset
from tactophone_lab.datasets.splits import SPLITS, split

MOST_ALIKE = 5
"""Most warnings of one kind that are printed one by one."""

EXAMPLES = (
    "tactophone dataset show recordings --plot recordings.png",
    "tactophone dataset check recordings --calibration calibration.toml",
    "tactophone dataset import downloads recordings",
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_action = options.add_actions(parser)

    def add(
        name: str, run: Callable[[argparse.Namespace], int], words: str
    ) -> argparse.ArgumentParser:
        sub = add_action(name, words, run)
        sub.add_argument(
            "folder",
            metavar="DIR",
            help="a data set, or class folders rough/ and smooth/",
        )
        return sub

    sub = add(
        "check",
        _check,
        "read every file and report what is wrong; exit 1 if a recording cannot be "
        "used",
    )
    sub.add_argument(
        "--calibration",
        type=Path,
        metavar="FILE",
        help="calibration with the contact threshold (default: "
        f"{DEFAULT_CONTACT_DBFS:g} dBFS)",
    )
    add_labels(sub)
    add_follow_links(sub)
    options.add_recorded_channels(sub)
    options.add_json(sub, "print JSON instead of a table")
    sub = add(
        "show",
        _show,
        "list surfaces, labels and recordings; with --plot, draw levels and "
        "spectrograms",
    )
    sub.add_argument("--plot", type=Path, metavar="PNG", help="figure to write")
    add_follow_links(sub)
    options.add_recorded_channels(sub)
    options.add_json(sub, "print JSON instead of a table")
    sub = add(
        "split",
        _split,
        "show the folds of a split; with --write, put train and test into the manifest",
    )
    sub.add_argument(
        "--by", default="4-fold", metavar="NAME", help=f"one of {', '.join(SPLITS)}"
    )
    words = "the fold whose test set --write takes, %(type)s"
    sub.add_argument("--fold", type=Within(int, 1), default=1, metavar="N", help=words)
    sub.add_argument(
        "--write", action="store_true", help="write the column split of metadata.csv"
    )
    options.add_json(sub, "print JSON instead of a table")
    sub = add(
        "import",
        _import,
        "convert another layout to this one, as FLAC: the paper's authors', "
        "manifest.csv, folders rough/ and smooth/, "
        "mono pairs piezo/x.wav and mems/x.wav or x_contact.wav and x_air.wav, "
        "file_name and label without surface, "
        "or an MCAP file that --record wrote",
    )
    sub.add_argument("out", type=Path, metavar="OUT", help="new folder to write to")
    options.add_recorded_channels(sub)
    sub.add_argument(
        "--surface",
        default="",
        metavar="NAME",
        help="surface that was touched, for an MCAP file",
    )
    sub.add_argument(
        "--label",
        default="",
        metavar="LABEL",
        help="none, smooth or rough, for an MCAP file",
    )
    sub = add("labels", _labels, "write the labels over time for other programs")
    sub.add_argument("out", type=Path, metavar="OUT", help="folder to write to")
    sub.add_argument(
        "--format",
        choices=("audacity", "dcase"),
        default="audacity",
        help="a label track for each recording, or one table of events "
        "(default: audacity)",
    )
    add("card", _card, "write a data card, README.md, in Hugging Face's format")


def _check(args: argparse.Namespace) -> int:
    dataset = open_as(args.folder, reading_of(args))
    threshold_dbfs = (
        Calibration.read(args.calibration).window_dbfs
        if args.calibration
        else DEFAULT_CONTACT_DBFS
    )
    with output.progress("checking", 2 * len(dataset.recordings)) as update:
        single = check(dataset, progress=lambda done: update(completed=done))
        across = check_consistency(
            dataset,
            threshold_dbfs=threshold_dbfs,
            progress=lambda done: update(advance=1),
        )
    problems = (*single, *across)
    if not any(problem.fatal for problem in problems):
        problems += _wrong_labels(dataset)
    count = len(dataset.recordings)
    output.show(
        {"recordings": count, "problems": problems},
        _words(count, problems),
        as_json=args.json,
    )
    return 1 if any(problem.fatal for problem in problems) else 0


def _wrong_labels(dataset: Dataset) -> tuple[Problem, ...]:
    """Return surfaces whose labels look wrong, where there are enough to tell and the
    extra ``train`` is installed."""
    from tactophone_lab.app.evaluate import can_check_labels, suspicious_labels

    if not can_check_labels(dataset):
        return ()
    with output.progress("checking labels") as update:
        report = lambda _what, done, total, note: update(  # noqa: E731
            completed=done, total=total, note=note
        )
        return tuple(suspicious_labels(dataset, report=report))


def _words(recordings: int, problems: Sequence[Problem]) -> Iterator[str]:
    """Yield a line for each problem; one for all warnings of a kind that many
    recordings share."""
    counts = Counter(problem.kind for problem in problems if not problem.fatal)
    for problem in problems:
        if problem.fatal or counts[problem.kind] <= MOST_ALIKE:
            yield f"{'error' if problem.fatal else 'warning'}: {problem}"
    for kind, count in counts.items():
        if count > MOST_ALIKE:
            first = next(
                problem
                for problem in problems
                if problem.kind == kind and not problem.fatal
            )
            yield f"warning: {count} times {kind!r}, such as {first}; --json lists all"
    bad = {problem.path for problem in problems if problem.fatal}
    found = f"{len(problems)} problem{'s' * (len(problems) != 1)}"
    yield (
        f"{recordings} recording{'s' * (recordings != 1)}, {len(bad)} unusable, {found}"
    )


def _show(args: argparse.Namespace) -> int:
    dataset = open_as(args.folder, reading_of(args))
    if args.plot:
        with output.as_private_as(*_paths_of(dataset)):
            draw_dataset(args.plot, dataset)
    surfaces = _surfaces(dataset)
    shown = {
        "name": dataset.name,
        "recordings": len(dataset.recordings),
        "surfaces": surfaces,
    }
    parts: list[output.Part] = [
        dataset.name,
        surfaces,
        *([str(args.plot)] if args.plot else []),
    ]
    output.show(shown, parts, as_json=args.json)
    return 0


def _paths_of(dataset: Dataset) -> Iterator[Path]:
    return (recording.path for recording in dataset.recordings)


def _split(args: argparse.Namespace) -> int:
    dataset = open_dataset(args.folder)
    folds = split(dataset, args.by)
    if args.write:
        if args.fold > len(folds):
            raise ConfigError(
                f"--fold {args.fold}: {args.by} has folds 1 to {len(folds)}"
            )
        fold = folds[args.fold - 1]
        sides = {
            recording.surface: {"split": side}
            for side, recordings in (("train", fold.train), ("test", fold.test))
            for recording in recordings
        }
        output.log().print(set_columns(dataset, sides), soft_wrap=True)
    tested = [
        (fold, sorted({recording.surface for recording in fold.test})) for fold in folds
    ]
    rows = [
        {"fold": fold.name, "train": len(fold.train), "test": surfaces}
        for fold, surfaces in tested
    ]
    table = [
        {
            "fold": fold.name,
            "recordings to train on": len(fold.train),
            "surfaces to test on": ", ".join(surfaces),
        }
        for fold, surfaces in tested
    ]
    output.show(rows, [table], as_json=args.json)
    return 0


def _import_log(args: argparse.Namespace, log: Path) -> int:
    """Make a take of each session of a log, and of each finger of a hand."""
    from tactophone.app.logged_run import write_sound

    if args.label not in LABEL_NAMES:
        raise ConfigError(
            f"--label {args.label}: must be one of "
            f"{', '.join(filter(None, LABEL_NAMES))}"
        )
    with TemporaryDirectory(prefix="tactophone-") as folder:
        takes = [
            Recording(
                sound.path,
                args.surface or log.stem,
                LABEL_NAMES[args.label],
                MICROPHONES[: soundfile.info(sound.path).channels],
                take="-".join(filter(None, (str(sound.session), sound.finger))),
                session=log.stem,
            )
            for sound in write_sound(log, Path(folder))
        ]
        with output.as_private_as(log):
            converted = convert(Dataset(log.stem, Path(folder), tuple(takes)), args.out)
    count = len(converted.recordings)
    print(f"{count} recording{'s' * (count != 1)} in {args.out}")
    return 0


def _import(args: argparse.Namespace) -> int:
    if is_mcap(Path(args.folder)):
        return _import_log(args, Path(args.folder))
    found = find_importable(args.folder)
    picked = with_picked_channels(found.dataset, args.channels)
    with output.progress("checking", len(found.dataset.recordings)) as update:
        kept, problems = usable(picked, progress=lambda done: update(completed=done))
    if not kept.recordings:
        raise nothing_usable(found.dataset, problems)
    with (
        output.as_private_as(*_paths_of(kept)),
        output.progress("converting", len(kept.recordings)) as update,
    ):
        converted = convert(
            kept,
            args.out,
            air_of=found.air_of,
            targets=found.targets,
            progress=lambda done: update(completed=done),
        )
    pairs = (
        f", {len(found.air_of)} of them joined from two mono files"
        if found.air_of
        else ""
    )
    print(f"{len(converted.recordings)} recordings{pairs} in {args.out}")
    for problem in problems:
        if not problem.fatal:
            output.note(f"warning: {problem}")
    report_left_out(args.folder, problems)
    if found.guessed:
        surfaces = converted.surfaces
        shown = ", ".join(surfaces[:6]) + (", ..." if len(surfaces) > 6 else "")
        output.note(
            f"warning: {len(surfaces)} surfaces were taken from file names: {shown}; "
            "correct the column surface of "
            f"{args.out / FILE_NAME} where two names are one surface, as splits keep "
            "a surface on one side"
        )
    return 0


def _labels(args: argparse.Namespace) -> int:
    dataset = open_dataset(args.folder)
    segments = {
        recording.path: segments_of(
            recording, duration=sound_info(recording.path).duration
        )
        for recording in dataset.recordings
    }
    if args.format == "dcase":
        print(write_events(args.out, segments, root=dataset.root))
        return 0
    count = len(write_tracks(args.out, segments, root=dataset.root))
    print(f"{count} label track{'s' * (count != 1)} in {args.out}")
    return 0


def _card(args: argparse.Namespace) -> int:
    print(write_card(open_dataset(args.folder)))
    return 0


def _surfaces(dataset: Dataset) -> list[dict[str, Any]]:
    """Return a row for each surface: its name, the values of three columns, and its
    number of recordings."""
    takes = {
        name: [each for each in dataset.recordings if each.surface == name]
        for name in dataset.surfaces
    }
    keys = ("label", "tier", "scenario")
    return [
        {"surface": name}
        | {
            key: ", ".join(sorted({take.known(key) or "-" for take in own}))
            for key in keys
        }
        | {"recordings": len(own)}
        for name, own in takes.items()
    ]
