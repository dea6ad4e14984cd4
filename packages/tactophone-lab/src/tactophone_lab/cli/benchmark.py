"""``tactophone benchmark``: every method on the same splits; a table, a JSON file and a
report with figures."""

import argparse
import json
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

from tactophone.cli import options, output
from tactophone.core.processes import atomic_write
from tactophone.core.recordings.values import Dataset
from tactophone_lab.cli.data import (
    add_folds,
    add_kin,
    add_selection,
    cache_of,
    open_filtered,
    reading_of,
)

if TYPE_CHECKING:
    from tactophone_lab.benchmark.folds import Cache
    from tactophone_lab.benchmark.results import DatasetResults

FAST_SECONDS = 3.0
"""Seconds of each simulated take, where no data is given."""

FAST_SEED = 5
"""Random seed of these takes."""

NOTES = (
    "Each table covers one data set and one split; every recording was predicted by a "
    "model that was trained without "
    "its side of the split. Intervals: 90 % of bootstrap draws of the surfaces. p: "
    "paired bootstrap against the first "
    "method; in brackets corrected (Holm) for all methods and measures of the table.",
    "As rendered: what the operator gets, contact gate, abstention and decision rule "
    "inside; a gap counts as wrong. "
    "Scores of windows count updates in true contact, whatever a method's own "
    "contact gate reports. Delays are over "
    "all changes: those without a correct decision within 0.6 s count as infinite. "
    "The control, texture trained "
    "and scored on labels permuted over the surfaces, should be at chance: what it "
    "scores over 0.5 it scores by "
    "recognising surfaces, not by roughness.",
)

EXAMPLES = (
    "tactophone benchmark --fast",
    "tactophone benchmark --data recordings --methods texture,level --splits 4-fold",
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    add(
        "--data",
        type=Path,
        action="append",
        default=[],
        metavar="DIR",
        help="a data set, repeatable; each is scored by itself, so that real and "
        "simulated sound never mix (default: a "
        "small simulated one, rendered first)",
    )
    add_selection(parser)
    options.add_recorded_channels(parser)
    add_kin(parser)
    add("--methods", metavar="LIST", help="names, separated by commas (default: all)")
    words = (
        "names, separated by commas, as `evaluate --split` takes them (default: by "
        "kin, and by stroke, "
        "pressure, scenario and session where the data has them)"
    )
    add("--splits", metavar="LIST", help=words)
    words = (
        "three folds by kin only, the network trained for 200 steps in place of "
        "600: minutes, not hours"
    )
    add("--fast", action="store_true", help=words)
    words = "folder for results.json, report.md and its figures"
    add("--out", type=Path, default=Path("benchmark"), metavar="DIR", help=words)
    add_folds(parser)
    options.add_json(parser, "print JSON instead of tables")


def run(args: argparse.Namespace) -> int:
    from tactophone_lab.benchmark.markdown_report import steps_by_profile, write_report

    cache = cache_of(args)
    output.make_folder(args.out)  # now, not after hours
    results = [_run(dataset, cache, args) for dataset in _datasets(args, cache)]
    summary = {
        "datasets": [asdict(of_dataset) for of_dataset in results],
        "profiles": steps_by_profile(),
    }
    with atomic_write(args.out / "results.json") as unfinished:
        unfinished.write_text(json.dumps(output.finite(summary), indent=1))
    report = write_report(args.out, results, notes=NOTES)
    output.show(summary, _parts(results), as_json=args.json)
    output.log().print(f"{report}, {args.out / 'results.json'}")
    return 0


def _datasets(args: argparse.Namespace, cache: "Cache") -> list[Dataset]:
    folders = args.data or [_simulated(cache.folder / "simulated", args.workers)]
    return [
        open_filtered(folder, args.filter, kin=args.kin, reading=reading_of(args))
        for folder in folders
    ]


def _simulated(folder: Path, workers: int) -> Path:
    from tactophone_lab.simulation.catalogue import catalogue
    from tactophone_lab.simulation.render import (
        RenderOptions,
        plan_dataset,
        render_dataset,
        write_manifest,
    )
    from tactophone_lab.simulation.takes import TAKES

    takes = [
        take for take in TAKES if take.name in ("long_medium", "short_light", "wiggle")
    ]
    objects = [obj for obj in catalogue() if obj.number >= 0]
    jobs = plan_dataset(
        objects, RenderOptions(duration=FAST_SECONDS, seed=FAST_SEED), takes=takes
    )
    with output.tracked(
        render_dataset(folder, jobs, processes=workers), "simulating", len(jobs)
    ) as rendered:
        for _ in rendered:
            pass
    write_manifest(folder, jobs)
    return folder


def _run(
    dataset: Dataset, cache: "Cache", args: argparse.Namespace
) -> "DatasetResults":
    from tactophone_lab.benchmark.plan import run_benchmark, splits_of

    splits = (
        args.splits.split(",") if args.splits else splits_of(dataset, fast=args.fast)
    )
    names = args.methods.split(",") if args.methods else ()
    with output.progress(dataset.name) as update:
        return run_benchmark(
            dataset,
            names,
            splits,
            cache,
            fast=args.fast,
            workers=args.workers,
            ray=args.ray,
            report=lambda done, of, name: update(completed=done, total=of, note=name),
        )


def _parts(results: "Sequence[DatasetResults]") -> Iterator[output.Part]:
    """Yield the columns that 80 characters hold, gate and abstention inside; the report
    has the rest."""
    from tactophone_lab.benchmark.markdown_report import (
        control_of,
        format_delay,
        steps_by_profile,
    )

    for of_dataset in results:
        for split in dict.fromkeys(result.split for result in of_dataset.results):
            yield f"{of_dataset.dataset} ({of_dataset.origin}), {split}"
            rows = [
                {
                    "method": result.method,
                    "as rendered": str(result.rendered.balanced_accuracy),
                    "AUC": f"{result.scores['two-class']['auc'].value:.2f}",
                    "s as r": f"{result.rendered.smooth_as_rough.value:.2f}",
                    "gaps": f"{result.rendered.gaps.value:.2f}",
                    "bumps/min": f"{result.bumps_per_minute:.0f}",
                    "edge, ms (never)": format_delay(result.edge_ms),
                }
                for result in of_dataset.results
                if result.split == split
            ]
            yield output.table(rows, padding=(0, 1, 0, 0))
            yield from (control_of(of_dataset, split), "")
    steps = ", ".join(
        f"{name} {pitch:.1f} / {both:.1f}"
        for name, (pitch, both) in steps_by_profile().items()
    )
    yield (
        "just-noticeable steps from smooth to rough, of frequency / with level: "
        f"{steps}"
    )
