"""``tactophone roughness``: Ra, Rq, Rz, RSm and Rdq of a measured profile or height
map."""

import argparse
import math
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

from rich.table import Table

from tactophone.cli import options, output
from tactophone.cli.options import Within
from tactophone.core.errors import ConfigError, DatasetError, did_you_mean

if TYPE_CHECKING:
    from tactophone_lab.datasets.roughness import HeightReport

EXAMPLES = (
    "tactophone roughness profile.npz --unit um",
    "tactophone roughness slate.npy --pixel 29.4e-6 --resolution 5",
    "tactophone roughness slate.npz --write-metadata recordings --surface slate",
)


def _listing(report: "HeightReport") -> Table:
    found = report.profile
    shown = [
        (name, f"{1e6 * value:.4g} um")
        for name, value in (("Ra", found.ra), ("Rq", found.rq), ("Rz", found.rz))
    ]
    shown.append(("RSm", "-" if math.isnan(found.rsm) else f"{1e3 * found.rsm:.4g} mm"))
    shown.append(("Rdq", f"{found.rdq:.4g}"))
    lines, columns = report.shape
    size = f"{columns} heights" if lines == 1 else f"{lines} rows of {columns} heights"
    step = 1e6 * report.step
    cutoff = 1e3 * report.cutoff
    return output.listing(
        [*shown, ("of", f"{size}, {step:.4g} um apart; Gaussian cut-off {cutoff:g} mm")]
    )


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    add(
        "file",
        type=Path,
        metavar="FILE",
        help="profile or height map: .npy, .npz (heights, step) or .png (grey)",
    )
    add(
        "--pixel",
        type=Within(float, 0, over=True, unit="m"),
        metavar="M",
        help="distance between heights, %(type)s, such as 29.4e-6; where FILE lacks it",
    )
    add(
        "--unit",
        choices=("m", "mm", "um", "nm"),
        default="m",
        help="unit of the heights and positions in FILE",
    )
    add(
        "--cutoff",
        type=Within(float, 0, over=True, unit="mm"),
        metavar="MM",
        help="cutoff of the Gaussian filter, %(type)s (default: by ISO 21920-3, from "
        "the Ra found)",
    )
    add(
        "--resolution",
        type=Within(float, 0, unit="um"),
        default=0.0,
        metavar="UM",
        help="height that the sensor just resolves, %(type)s: a smaller Ra is "
        "reported with a warning",
    )
    add(
        "--write-metadata",
        type=Path,
        metavar="DIR",
        help="data set to write the columns ra_um, rz_um, rsm_um into",
    )
    add("--surface", metavar="NAME", help="surface of that data set which was measured")
    options.add_json(parser, "print JSON, lengths in m, instead of a table")


def run(args: argparse.Namespace) -> int:
    from tactophone_lab.datasets.roughness import measure_heights, read_heights

    if bool(args.write_metadata) != bool(args.surface):
        raise ConfigError(
            "--write-metadata DIR and --surface NAME belong together: name both"
        )
    heights, stated = read_heights(args.file, unit=args.unit)
    step = args.pixel or stated
    if step is None:
        raise ConfigError(
            f"{args.file} does not state how far apart its heights are: give --pixel, "
            "in m"
        )
    cutoff = args.cutoff * 1e-3 if args.cutoff else None
    try:
        report = measure_heights(
            heights, step=step, cutoff=cutoff, resolution=args.resolution * 1e-6
        )
    except ValueError as error:
        raise DatasetError(f"{args.file}: {error}") from None
    written = _write(args, report) if args.write_metadata else None
    output.show(
        {"file": args.file, **asdict(report)}, [_listing(report)], as_json=args.json
    )
    for note in () if args.json else report.notes:
        output.note(f"warning: {note}")
    if written:
        output.log().print(written, soft_wrap=True)
    return 0


def _write(args: argparse.Namespace, report: "HeightReport") -> Path:
    from tactophone_lab.datasets.convert import set_columns
    from tactophone_lab.datasets.open import open_dataset

    dataset = open_dataset(args.write_metadata)
    if args.surface not in dataset.surfaces:
        hint = (
            did_you_mean(args.surface, dataset.surfaces)
            or "; `tactophone dataset show` lists all"
        )
        raise DatasetError(f"{dataset.root}: no surface {args.surface!r}{hint}")
    found = report.profile
    heights = {"ra_um": found.ra, "rz_um": found.rz, "rsm_um": found.rsm}
    columns = {
        name: "" if math.isnan(height) else f"{height * 1e6:.4g}"
        for name, height in heights.items()
    }
    return set_columns(dataset, {args.surface: columns})
