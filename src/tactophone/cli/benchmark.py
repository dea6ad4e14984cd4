"""``tactophone benchmark``: every method on the same splits; a table, a JSON file and a report with figures."""

import argparse
import json
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

from rich.box import SIMPLE
from rich.table import Table

from tactophone.cli._support import fold_options, terminal
from tactophone.cli._support.dataset_options import add_filter, add_kin, open_filtered
from tactophone.cli._support.folders import make_folder
from tactophone.cli._support.ranges import Within
from tactophone.dataset import Dataset
from tactophone.json_numbers import finite

if TYPE_CHECKING:
    from tactophone.benchmark import Cache
    from tactophone.benchmark.results import Cost, DatasetResults

FAST_SECONDS, FAST_SEED = 3.0, 5
"""Of the simulated takes that are rendered where no data is given."""

NOTES = (
    "Each table is of one data set and one split; every recording was predicted by a model that was trained without "
    "its side of the split. Intervals: 90 % of bootstrap draws of the surfaces. p: paired bootstrap against the first "
    "method; in brackets corrected (Holm) for all methods and measures of the table.",
    "As rendered: what the operator gets, contact gate, abstention and decision rule inside; a gap counts as wrong. "
    "Scores of windows are of updates in true contact, whatever a method's own contact gate reports. Delays are over "
    "all changes: those without a correct decision within 0.6 s count as infinite. Two controls should be at chance: "
    "one uses only the band over 8 kHz, which carries nothing of the surface; the other is texture, "
    "trained and scored on labels permuted over the surfaces. What it scores over 0.5 it scores by recognising "
    "surfaces, not by roughness.",
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the verb's arguments."""
    parser.add_argument(
        "--data", type=Path, action="append", default=[], metavar="DIR",
        help="a data set, repeatable; each is scored by itself, so that real and simulated sound never mix (default: a "
        "small simulated one, rendered first)",
    )  # fmt: skip
    add_filter(parser)
    add_kin(parser)
    parser.add_argument("--methods", metavar="LIST", help="names, separated by commas (default: all)")
    parser.add_argument(
        "--splits", metavar="LIST",
        help="names, separated by commas, as `evaluate --split` takes them (default: by kin, and by stroke, "
        "pressure, scenario and session where the data has them)",
    )  # fmt: skip
    parser.add_argument(
        "--fast",
        action="store_true",
        help="three folds by kin only, the network trained for 200 steps in place of 600: minutes, not hours",
    )
    parser.add_argument(
        "--out", type=Path, default=Path("benchmark"), metavar="DIR", help="for results.json, report.md and its figures"
    )
    fold_options.add_arguments(parser)
    parser.add_argument("--table1", action="store_true", help="print Table I beside the paper's; authors' layout")
    parser.add_argument("--table2", action="store_true", help="print Table II beside the paper's; authors' layout")
    parser.add_argument(
        "--table3", action="store_true",
        help="print the paper's task with a simulated operator; --methods also takes paths of model files",
    )  # fmt: skip
    parser.add_argument("--rounds", type=Within(int, 1), default=1000, metavar="N", help="rounds of the task, %(type)s")
    parser.add_argument(
        "--retrieval", type=Within(float, 0, unit="s"), default=0.0, metavar="S",
        help="time to fetch the stone, added to the decision time in Table III, %(type)s; the paper states none",
    )  # fmt: skip
    parser.add_argument("--json", action="store_true", help="print JSON instead of tables")


def run(args: argparse.Namespace) -> int:
    """Run, score and report."""
    from tactophone.benchmark.plan import measure_costs
    from tactophone.benchmark.report import steps_by_profile, write_report

    cache = fold_options.cache_of(args)
    if args.table1 or args.table2 or args.table3:
        from tactophone.cli._support.paper_tables import print_tables

        return print_tables(args, _datasets(args, cache) if args.table1 or args.table2 else [], cache)
    make_folder(args.out)  # now, not after hours
    results: list[DatasetResults] = []
    costs: dict[str, dict[str, Cost]] = {}
    for dataset in _datasets(args, cache):
        results.append(_run(dataset, cache, args))
        names = dict.fromkeys(result.method for result in results[-1].results if not result.control)
        costs[dataset.name] = measure_costs(dataset, list(names), cache.folder / "costs")
    summary = {
        "datasets": [asdict(of_dataset) for of_dataset in results],
        "costs": {name: {method: asdict(cost) for method, cost in methods.items()} for name, methods in costs.items()},
        "profiles": steps_by_profile(),
    }
    (args.out / "results.json").write_text(json.dumps(finite(summary), indent=1))
    report = write_report(args.out, results, costs=costs, notes=NOTES)
    if args.json:
        terminal.print_json(summary)
        return 0
    _show(results, costs)
    terminal.log().print(f"{report}, {args.out / 'results.json'}")
    return 0


def _datasets(args: argparse.Namespace, cache: "Cache") -> list[Dataset]:
    folders = args.data or [_simulated(cache.folder / "simulated", args.workers)]
    return [open_filtered(folder, args.filter, kin=args.kin) for folder in folders]


def _simulated(folder: Path, workers: int) -> Path:
    """Render a small simulated set, once."""
    from tactophone.simulation.catalogue import catalogue
    from tactophone.simulation.render import RenderOptions, plan_dataset, render_dataset, write_manifest
    from tactophone.simulation.takes import TAKES

    takes = [take for take in TAKES if take.name in ("long_medium", "short_light", "wiggle")]
    objects = [obj for obj in catalogue() if obj.number >= 0]
    jobs = plan_dataset(objects, RenderOptions(duration=FAST_SECONDS, seed=FAST_SEED), takes=takes)
    with terminal.tracked(render_dataset(folder, jobs, processes=workers), "simulating", len(jobs)) as rendered:
        for _ in rendered:
            pass
    write_manifest(folder, jobs)
    return folder


def _run(dataset: Dataset, cache: "Cache", args: argparse.Namespace) -> "DatasetResults":
    from tactophone.benchmark.plan import plan_for, run_plan, splits_of

    splits = args.splits.split(",") if args.splits else splits_of(dataset, fast=args.fast)
    plan = plan_for(dataset, args.methods.split(",") if args.methods else (), splits, fast=args.fast)
    with terminal.progress(dataset.name) as update:
        return run_plan(
            plan, cache, workers=args.workers, ray=args.ray,
            report=lambda done, of, name: update(completed=done, total=of, note=name),
        )  # fmt: skip


def _show(results: Sequence["DatasetResults"], costs: dict[str, dict[str, "Cost"]]) -> None:
    from tactophone.benchmark.report import notes_of, steps_by_profile

    out = terminal.out()
    for of_dataset in results:
        for split in dict.fromkeys(result.split for result in of_dataset.results):
            table = _table_of(of_dataset, split, costs.get(of_dataset.dataset, {}))
            out.print(f"{of_dataset.dataset} ({of_dataset.origin}), {split}", table)
            for note in notes_of(of_dataset, split):
                out.print(note)
            out.print()
    steps = ", ".join(f"{name} {pitch:.1f} / {both:.1f}" for name, (pitch, both) in steps_by_profile().items())
    out.print(f"just-noticeable steps from smooth to rough, of frequency / with level: {steps}")


def _table_of(of_dataset: "DatasetResults", split: str, costs: dict[str, "Cost"]) -> Table:
    """The columns that 80 characters hold, gate and abstention inside; the report has the rest."""
    from tactophone.benchmark.report import format_delay

    table = Table("method", "as rendered", box=SIMPLE, pad_edge=False, padding=(0, 1, 0, 0))
    for name in ("AUC", "s as r", "gaps", "bumps/min", "edge, ms (never)", "us"):
        table.add_column(name, justify="right")
    for result in (result for result in of_dataset.results if result.split == split):
        scores, cost, rendered = result.scores["two-class"], costs.get(result.method), result.rendered
        table.add_row(
            result.method.removeprefix("control: "), str(rendered.balanced_accuracy), f"{scores['auc'].value:.2f}",
            f"{rendered.smooth_as_rough.value:.2f}", f"{rendered.gaps.value:.2f}", f"{result.bumps_per_minute:.0f}",
            format_delay(result.edge_ms), f"{cost.update_us:.0f}" if cost else "",
        )  # fmt: skip
    return table
