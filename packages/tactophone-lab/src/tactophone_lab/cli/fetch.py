"""``tactophone fetch``: published data sets, as data sets of this package."""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from tactophone.cli import options, output
from tactophone_lab.app.fetch import ARCHIVE, LICENCE

if TYPE_CHECKING:
    from tactophone_lab.datasets.published_labels import ImportedSet

EXAMPLES = (
    "tactophone fetch authors authors",
    "tactophone fetch biotac downloaded biotac",
    "tactophone fetch cluster downloaded cluster",
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add_action = options.add_actions(parser)
    words = "download and unpack the recordings of the paper's authors"
    add = add_action("authors", words, _authors).add_argument
    add("out", type=Path, metavar="OUT", help="folder to unpack into")
    add(
        "--archive",
        default=ARCHIVE,
        metavar="URL",
        help="where the archive is, if it has moved",
    )
    add(
        "--sha256",
        default="",
        metavar="HASH",
        help="checksum that the archive must have; none was published",
    )
    words = "convert downloaded BioTac vibration: CSV files, their folder the surface"
    _add_folders(add_action("biotac", words, _biotac))
    words = "convert the downloaded Cluster Haptic Texture Dataset, one air microphone"
    _add_folders(add_action("cluster", words, _cluster))


def _add_folders(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "folder",
        type=Path,
        metavar="DIR",
        help="the unpacked download; neither set states roughness, which a file "
        "labels.csv with the columns surface and label adds",
    )
    parser.add_argument("out", type=Path, metavar="OUT", help="folder to write to")


def _authors(args: argparse.Namespace) -> int:
    from tactophone_lab.app.fetch import fetch_authors

    output.note(f"licence: {LICENCE}")
    fetched = fetch_authors(args.out, archive=args.archive, sha256=args.sha256)
    output.note(f"SHA-256 {fetched.sha256}; cite the authors")
    print(fetched.folder)
    return 0


def _biotac(args: argparse.Namespace) -> int:
    from tactophone_lab.datasets.biotac import import_biotac

    return _show(import_biotac(args.folder, args.out), args.out)


def _cluster(args: argparse.Namespace) -> int:
    from tactophone_lab.datasets.cluster import import_cluster

    return _show(import_cluster(args.folder, args.out), args.out)


def _show(imported: "ImportedSet", out: Path) -> int:
    for problem in imported.problems:
        output.note(f"left out: {problem}")
    print(f"{len(imported.recordings)} recordings in {out}")
    if not imported.labelled:
        output.note(
            "warning: no labels; add labels.csv with the columns surface and label to "
            "the folder"
        )
    return 0
