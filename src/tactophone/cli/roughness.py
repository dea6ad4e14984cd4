"""``tactophone roughness``: Ra, Rq, Rz, RSm, Rdq, Sa, Sq and Sz of a measured profile or height map."""

import argparse
import math
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tactophone.cli import options, output
from tactophone.cli.options import Within
from tactophone.errors import ConfigError, DatasetError, did_you_mean

if TYPE_CHECKING:
    from tactophone.dataset.heights import HeightReport


EXAMPLES = (
    "tactophone roughness profile.csv --unit um",
    "tactophone roughness slate.png --pixel 29.4e-6 --height-range 120 --plot slate-heights.png",
    "tactophone roughness slate.npz --write-metadata recordings --surface slate",
)


@dataclass(frozen=True, slots=True)
class Heights:
    """The roughness parameters of a profile or height map."""

    file: Path
    report: "HeightReport"

    def as_json(self) -> dict[str, Any]:
        return {"file": self.file, **asdict(self.report)}

    def parts(self) -> Iterator[output.Part]:
        found, area = self.report.profile, self.report.area
        rows = [("Ra", found.ra), ("Rq", found.rq), ("Rz", found.rz)]
        rows += [("Sa", area.sa), ("Sq", area.sq), ("Sz", area.sz)] if area else []
        shown = [(name, f"{1e6 * value:.4g} um") for name, value in rows]
        shown.append(("RSm", "-" if math.isnan(found.rsm) else f"{1e3 * found.rsm:.4g} mm"))
        shown.append(("Rdq", f"{found.rdq:.4g}"))
        lines, columns = self.report.shape
        size = f"{columns} heights" if lines == 1 else f"{lines} rows of {columns} heights"
        step, cutoff = 1e6 * self.report.step, 1e3 * self.report.cutoff
        yield output.listing([*shown, ("of", f"{size}, {step:.4g} um apart; Gaussian cut-off {cutoff:g} mm")])


def add_arguments(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "file", type=Path, metavar="FILE",
        help="profile or height map: .npy, .npz (heights, step), .csv (a column, or a map), .png",
    )  # fmt: skip
    parser.add_argument(
        "--pixel", type=Within(float, 0, over=True, unit="m"), metavar="M",
        help="distance between heights, %(type)s, such as 29.4e-6; where FILE lacks it",
    )  # fmt: skip
    parser.add_argument(
        "--unit", choices=("m", "mm", "um", "nm"), default="m", help="of the heights (and of places) in FILE"
    )
    parser.add_argument(
        "--height-range", type=Within(float, 0, over=True, unit="um"), metavar="UM",
        help="height of white over black in a PNG, %(type)s",
    )  # fmt: skip
    parser.add_argument(
        "--cutoff", type=Within(float, 0, over=True, unit="mm"), metavar="MM",
        help="of the Gaussian filter, %(type)s (default: as ISO 21920-3 names it for the Ra found)",
    )  # fmt: skip
    parser.add_argument(
        "--resolution", type=Within(float, 0, unit="um"), default=0.0, metavar="UM",
        help="height that the sensor just resolves, %(type)s: a smaller Ra is reported with a warning",
    )  # fmt: skip
    parser.add_argument("--plot", type=Path, metavar="PNG", help="figure to write")
    parser.add_argument(
        "--write-metadata", type=Path, metavar="DIR", help="data set to write the columns ra_um, rz_um, rsm_um into"
    )
    parser.add_argument("--surface", metavar="NAME", help="surface of that data set which was measured")
    options.add_json(parser, "print JSON, lengths in m, instead of a table")


def run(args: argparse.Namespace) -> int:
    from tactophone.dataset.heights import draw_heights, measure_heights, read_heights

    if bool(args.write_metadata) != bool(args.surface):
        raise ConfigError("--write-metadata DIR and --surface NAME belong together: name both")
    height_range = args.height_range * 1e-6 if args.height_range else None
    heights, stated = read_heights(args.file, unit=args.unit, height_range=height_range)
    step = args.pixel or stated
    if step is None:
        raise ConfigError(f"{args.file} does not state how far apart its heights are: give --pixel, in m")
    cutoff = args.cutoff * 1e-3 if args.cutoff else None
    try:
        report = measure_heights(heights, step=step, cutoff=cutoff, resolution=args.resolution * 1e-6)
    except ValueError as error:
        raise DatasetError(f"{args.file}: {error}") from None
    if args.plot:
        draw_heights(args.plot, heights, report, title=args.file.stem)
    written = _write(args, report) if args.write_metadata else None
    output.show(Heights(args.file, report), as_json=args.json)
    for note in () if args.json else report.notes:
        output.note(f"beware: {note}")
    for path in filter(None, (args.plot, written)):
        output.log().print(path, soft_wrap=True)
    return 0


def _write(args: argparse.Namespace, report: "HeightReport") -> Path:
    from tactophone.dataset.metadata import FILE_NAME, write_metadata
    from tactophone.dataset.read import open_dataset

    dataset = open_dataset(args.write_metadata)
    if not (dataset.root / FILE_NAME).is_file():
        raise DatasetError(f"{dataset.root}: no {FILE_NAME} to write to; `tactophone dataset import` makes one")
    if args.surface not in dataset.surfaces:
        hint = did_you_mean(args.surface, dataset.surfaces) or "; `tactophone dataset show` lists all"
        raise DatasetError(f"{dataset.root}: no surface {args.surface!r}{hint}")
    found = report.profile
    heights = {"ra_um": found.ra, "rz_um": found.rz, "rsm_um": found.rsm}
    columns = {name: "" if math.isnan(height) else f"{height * 1e6:.4g}" for name, height in heights.items()}
    recordings = [
        recording.with_properties(**columns) if recording.surface == args.surface else recording
        for recording in dataset.recordings
    ]
    return write_metadata(dataset.root, recordings)
