"""Options of verbs that read a data set, train on it, or run folds of it."""

import argparse
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import ExitStack, contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from tactophone.cli import options, output
from tactophone.cli.options import PROCESSES
from tactophone.core.errors import DatasetError
from tactophone.core.recordings.values import Dataset, Problem
from tactophone_lab.datasets.checks import (
    channels_of_all,
    nothing_usable,
    usable,
    with_channels,
    with_picked_channels,
)
from tactophone_lab.datasets.open import open_dataset, phone_sounds
from tactophone_lab.datasets.splits import with_kin

if TYPE_CHECKING:
    from tactophone_lab.app.evaluate import Progress
    from tactophone_lab.benchmark.folds import Cache


def add_follow_links(parser: options.Container) -> None:
    words = (
        "also read sound outside of DIR that a link in DIR leads to (default: it is "
        "named and left out); it is never copied"
    )
    parser.add_argument("--follow-links", action="store_true", help=words)


def add_selection(parser: argparse.ArgumentParser) -> None:
    """Add which recordings of a data set are read, and what their labels mean."""
    add_follow_links(parser)
    add_labels(parser)
    words = (
        "keep only recordings whose tier, surface, scenario or other key has one "
        "of these values; repeatable"
    )
    parser.add_argument(
        "--filter", action="append", metavar="KEY=VALUE[,VALUE...]", help=words
    )


def add_labels(parser: argparse.ArgumentParser) -> None:
    words = (
        "what labels, numbers or names of folders mean, as 0=smooth,1=rough or "
        "rau=rough,glatt=smooth (default: labels.toml or the data card beside them)"
    )
    parser.add_argument("--labels", metavar="YOURS=LABEL[,...]", help=words)


@dataclass(frozen=True, slots=True)
class Reading:
    """How the files of a data set are read.

    ``places`` are the channels of contact and air in files of more than two, counted
    from 0; ``follow_links`` and ``labels`` as for `open_dataset`.
    """

    places: tuple[int, ...] = ()
    follow_links: bool = False
    labels: Mapping[str, str] | None = None


def reading_of(args: argparse.Namespace) -> Reading:
    """Return how the options of a verb say that files are read."""
    # `train` also takes a count of microphones as --channels.
    places = args.channels if isinstance(args.channels, tuple) else ()
    # Verbs that only copy or show a data set take no labels.
    given = getattr(args, "labels", None)
    labels = dict(options.assigned(given.split(","), "--labels")) if given else None
    return Reading(places, args.follow_links, labels)


def open_as(folder: Path, reading: Reading) -> Dataset:
    """Open a data set, read as the options say; errors as `open_dataset`."""
    dataset = open_dataset(
        folder, labels=reading.labels, follow_links=reading.follow_links
    )
    return with_picked_channels(dataset, reading.places)


def add_kin(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "--kin",
        type=Path,
        metavar="CSV",
        help="file with the columns surface,kin: surfaces of one kin stay on one side "
        "of a split (default: "
        "the column kin, or the versions of a surface, by name)",
    )


def add_folds(parser: options.Container) -> None:
    """Add where folds run, and where their results are kept."""
    add = parser.add_argument
    add(
        "--workers",
        type=PROCESSES,
        default=2,
        metavar="N",
        help="processes, %(type)s",
    )
    add(
        "--ray",
        action="store_true",
        help="run folds on a Ray cluster: RAY_ADDRESS, or a local one",
    )
    add(
        "--cache",
        type=Path,
        metavar="DIR",
        help="folder for the folds' results (default: the user's cache)",
    )


def cache_of(args: argparse.Namespace) -> "Cache":
    from tactophone_lab.benchmark.folds import Cache, default_cache

    return Cache(args.cache) if args.cache else default_cache()


def open_filtered(
    folder: Path,
    filters: list[str] | None,
    *,
    channels: int = 1,
    kin: Path | None = None,
    segments: bool = False,
    reading: Reading = Reading(),
) -> Dataset:
    """Open a data set, apply the filters, and drop unusable recordings, each reported
    on stderr.

    Recordings with fewer ``channels`` are dropped where others have as many. With
    ``segments``, recordings with several labels are kept. Raises `DatasetError` if
    nothing is left.
    """
    dataset = open_as(folder, reading)
    for text in filters or ():
        dataset = _filtered(dataset, text)
    kept, problems = usable(dataset)
    report_left_out(folder, problems)
    if dataset.recordings and not kept.recordings:
        raise nothing_usable(dataset, problems)
    kept, lacking = with_channels(kept.labelled(segments=segments), channels)
    for problem in lacking:
        output.note(f"left out: {problem}")
    return with_kin(kept, kin) if kin else kept


def report_left_out(folder: Path | str, problems: Sequence[Problem]) -> None:
    """Name on stderr each recording that is not used and why, and sound that nothing
    here can read."""
    bad = [problem for problem in problems if problem.fatal]
    for problem in bad:
        output.note(f"left out: {problem}")
    if bad:
        count = len({problem.path for problem in bad})
        output.note(f"{count} left out; the rest is used")
    if Path(folder).is_dir() and (unread := phone_sounds(Path(folder))):
        output.note(f"left out: {unread}")


def is_mono(folder: Path, reading: Reading) -> bool:
    """Return whether the recordings of a data set have one channel alone."""
    return channels_of_all(open_as(folder, reading)) == 1


@contextmanager
def bars() -> "Iterator[Progress]":
    """Show a bar for each thing that is done, one after the other."""
    shown: dict[str, Callable[..., None]] = {}
    with ExitStack() as stack:

        def report(what: str, done: int, total: int, name: str) -> None:
            if what not in shown:
                stack.close()
                shown[what] = stack.enter_context(output.progress(what, total))
            shown[what](completed=done, total=total, note=name)

        yield report


def _filtered(dataset: Dataset, text: str) -> Dataset:
    key, equals, values = text.partition("=")
    if not equals:
        raise DatasetError(f"--filter {text}: write KEY=VALUE, such as tier=core")
    allowed = set(values.split(","))
    kept = dataset.where(lambda recording: recording.known(key) in allowed)
    if not kept.recordings:
        known = sorted(
            {recording.known(key) or "(nothing)" for recording in dataset.recordings}
        )
        raise DatasetError(
            f"--filter {text}: no recording has it; {key} is one of "
            f"{', '.join(known[:12])}"
        )
    return kept
