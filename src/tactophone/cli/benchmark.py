"""``tactophone benchmark``: every method on the same splits; a table, a JSON file and a report with figures."""

import argparse
import json
import math
import re
from collections.abc import Iterator, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING

from rich.text import Text

from tactophone.cli import options, output
from tactophone.cli.data import add_filter, add_folds, add_kin, cache_of, open_filtered
from tactophone.cli.options import Within
from tactophone.lab.dataset.values import Dataset

if TYPE_CHECKING:
    from tactophone.lab.benchmark.folds import Cache
    from tactophone.lab.benchmark.paper_tables import TableRow
    from tactophone.lab.benchmark.results import DatasetResults
    from tactophone.lab.evaluation.bootstrap import Estimate
    from tactophone.lab.evaluation.predict import TakePredictions

FAST_SECONDS, FAST_SEED = 3.0, 5
"""Length of the simulated takes, and their random seed, where no data is given."""

NOTES = (
    "Each table is of one data set and one split; every recording was predicted by a model that was trained without "
    "its side of the split. Intervals: 90 % of bootstrap draws of the surfaces. p: paired bootstrap against the first "
    "method; in brackets corrected (Holm) for all methods and measures of the table.",
    "As rendered: what the operator gets, contact gate, abstention and decision rule inside; a gap counts as wrong. "
    "Scores of windows are of updates in true contact, whatever a method's own contact gate reports. Delays are over "
    "all changes: those without a correct decision within 0.6 s count as infinite. The control, texture trained "
    "and scored on labels permuted over the surfaces, should be at chance: what it scores over 0.5 it scores by "
    "recognising surfaces, not by roughness.",
)

EXAMPLES = (
    "tactophone benchmark --fast",
    "tactophone benchmark --data recordings --methods texture,level --splits 4-fold",
    "tactophone benchmark --table3 --rounds 100",
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    add("--data", type=Path, action="append", default=[], metavar="DIR",
        help="a data set, repeatable; each is scored by itself, so that real and simulated sound never mix (default: a "
        "small simulated one, rendered first)")  # fmt: skip
    add_filter(parser)
    add_kin(parser)
    add("--methods", metavar="LIST", help="names, separated by commas (default: all)")
    add(
        "--splits",
        metavar="LIST",
        help="names, separated by commas, as `evaluate --split` takes them (default: by kin, and by stroke, "
        "pressure, scenario and session where the data has them)",
    )
    add(
        "--fast",
        action="store_true",
        help="three folds by kin only, the network trained for 200 steps in place of 600: minutes, not hours",
    )
    add(
        "--out", type=Path, default=Path("benchmark"), metavar="DIR", help="for results.json, report.md and its figures"
    )
    add_folds(parser)
    add("--table1", action="store_true", help="print Table I beside the paper's; authors' layout")
    add("--table2", action="store_true", help="print Table II beside the paper's; authors' layout")
    add(
        "--table3",
        action="store_true",
        help="print the paper's task with a simulated operator; --methods also takes paths of model files",
    )
    add(
        "--ablations",
        type=Path,
        metavar="DIR",
        help="score the paper's network by each recipe file in DIR, on the first of --splits (default: 3-fold by kin)",
    )
    add("--rounds", type=Within(int, 1), default=1000, metavar="N", help="rounds of the task, %(type)s")
    options.add_json(parser, "print JSON instead of tables")


def run(args: argparse.Namespace) -> int:
    from tactophone.lab.benchmark.report import steps_by_profile, write_report

    cache = cache_of(args)
    if args.table1 or args.table2 or args.table3:
        return print_tables(args, _datasets(args, cache) if args.table1 or args.table2 else [], cache)
    if args.ablations:
        return _print_ablations(args, cache)
    output.make_folder(args.out)  # now, not after hours
    results = [_run(dataset, cache, args) for dataset in _datasets(args, cache)]
    summary = {"datasets": [asdict(of_dataset) for of_dataset in results], "profiles": steps_by_profile()}
    (args.out / "results.json").write_text(json.dumps(output.finite(summary), indent=1))
    report = write_report(args.out, results, notes=NOTES)
    output.show(summary, _parts(results), as_json=args.json)
    output.log().print(f"{report}, {args.out / 'results.json'}")
    return 0


def _print_ablations(args: argparse.Namespace, cache: "Cache") -> int:
    from tactophone.lab.benchmark.paper_tables import ablation_rows, ablations_in
    from tactophone.lab.benchmark.plan import origin_of

    methods = ablations_in(args.ablations)
    for dataset in _datasets(args, cache):
        name = args.splits.split(",")[0] if args.splits else "3-fold"
        with output.progress("ablations", len(methods)) as update:
            rows = ablation_rows(methods, dataset, name, cache, report=lambda done, of: update(completed=done, note=of))
        title = f"The paper's network and what its authors tried, {dataset.name} ({origin_of(dataset)}), {name}"
        table = [{"network": row.name, **{name: str(value) for name, value in row.values.items()}} for row in rows]
        note = "Windows in true contact, two-class rule; 90 % intervals over surfaces."
        parts: list[output.Part] = [title, table, note]
        output.show({"title": title, "lines": rows}, parts, as_json=args.json)
    return 0


def _datasets(args: argparse.Namespace, cache: "Cache") -> list[Dataset]:
    folders = args.data or [_simulated(cache.folder / "simulated", args.workers)]
    return [open_filtered(folder, args.filter, kin=args.kin) for folder in folders]


def _simulated(folder: Path, workers: int) -> Path:
    from tactophone.lab.simulation.catalogue import catalogue
    from tactophone.lab.simulation.render import RenderOptions, plan_dataset, render_dataset, write_manifest
    from tactophone.lab.simulation.takes import TAKES

    takes = [take for take in TAKES if take.name in ("long_medium", "short_light", "wiggle")]
    objects = [obj for obj in catalogue() if obj.number >= 0]
    jobs = plan_dataset(objects, RenderOptions(duration=FAST_SECONDS, seed=FAST_SEED), takes=takes)
    with output.tracked(render_dataset(folder, jobs, processes=workers), "simulating", len(jobs)) as rendered:
        for _ in rendered:
            pass
    write_manifest(folder, jobs)
    return folder


def _run(dataset: Dataset, cache: "Cache", args: argparse.Namespace) -> "DatasetResults":
    from tactophone.lab.benchmark.plan import run_benchmark, splits_of

    splits = args.splits.split(",") if args.splits else splits_of(dataset, fast=args.fast)
    names = args.methods.split(",") if args.methods else ()
    with output.progress(dataset.name) as update:
        return run_benchmark(
            dataset, names, splits, cache, fast=args.fast, workers=args.workers, ray=args.ray,
            report=lambda done, of, name: update(completed=done, total=of, note=name),
        )  # fmt: skip


def _parts(results: "Sequence[DatasetResults]") -> Iterator[output.Part]:
    """Yield the columns that 80 characters hold, gate and abstention inside; the report has the rest."""
    from tactophone.lab.benchmark.report import control_of, format_delay, steps_by_profile

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
    steps = ", ".join(f"{name} {pitch:.1f} / {both:.1f}" for name, (pitch, both) in steps_by_profile().items())
    yield f"just-noticeable steps from smooth to rough, of frequency / with level: {steps}"


def print_tables(args: argparse.Namespace, datasets: Sequence[Dataset], cache: "Cache") -> int:
    """Print the tables that ``args`` names; I and II of each data set."""
    from tactophone.lab.benchmark.paper_tables import by_gate, table_one, table_two
    from tactophone.lab.benchmark.plan import origin_of

    for dataset in datasets:
        predictions = _predict(dataset, args.methods.split(",") if args.methods else (), cache)
        for gate, gated in by_gate(predictions, dataset.recordings).items():
            for chosen, make, title in ((args.table1, table_one, "Table I"), (args.table2, table_two, "Table II")):
                if chosen:
                    heading = f"{title}, {dataset.name} ({origin_of(dataset)}), {gate}"
                    rows = make(gated)
                    output.show({"title": heading, "lines": rows}, paper_parts(heading, rows), as_json=args.json)
    if args.table3:
        _print_task(args)
    return 0


def _predict(dataset: Dataset, names: Sequence[str], cache: "Cache") -> "dict[str, list[TakePredictions]]":
    from tactophone.lab.benchmark.paper_tables import predict_held_out

    with output.progress("Tables I and II") as update:
        return predict_held_out(dataset, names, cache, report=lambda name: update(note=name))


def paper_parts(title: str, rows: "Sequence[TableRow]") -> list[output.Part]:
    """Return one of the paper's Tables I and II as eight columns in 80 characters, a heading's word a line."""
    cells = [
        {"": row.name, **{re.sub("[_ ]", "\n", name): _cell(value) for name, value in row.values.items()}}
        for row in rows
    ]
    note = Text(
        "Below a score, its 90 % interval over takes of the test objects and 5 s pieces of the competition's runs: one "
        "object a class says nothing of other objects."
    )
    return [title, output.table(cells, padding=(0, 1, 0, 0)), note]


def _cell(score: "Estimate") -> str:
    if math.isnan(score.low):
        return "-" if math.isnan(score.value) else f"{score.value:.3f}"
    # Two lines, and no leading zeros, so that eight columns fit.
    low, high = (f"{end:.2f}".removeprefix("0") for end in (score.low, score.high))
    return f"{score.value:.3f}\n{low}-{high}"


def _print_task(args: argparse.Namespace) -> None:
    from tactophone.lab.benchmark.paper_tables import PAPER_THREE, play_task, task_methods

    names = args.methods.split(",") if args.methods else task_methods()
    with output.progress("simulated operator", len(names) + 1) as update:
        outcomes = play_task(names, rounds=args.rounds, report=lambda name: update(advance=1, note=name))
    times = [(team, day, time) for team, own in PAPER_THREE.items() for day, time in enumerate(own, 1)]
    paper = [{"name": f"paper's own: {team}, day {day}", "task": time} for team, day, time in times]
    teams: dict[str, dict[str, str]] = {team: {"team": team} for team in PAPER_THREE}
    for team, day, time in times:
        teams[team][f"day {day}"] = "N/A" if time is None else f"{time // 60}:{time % 60:02}"
    headings = ("method", "rough one found", "both found", "decision time (s)")
    parts: list[output.Part] = [
        "Table III as the paper has it: min:s until a rough stone was fetched; N/A: not attempted",
        list(teams.values()),
        f"Table III: SIMULATED OPERATOR, five stones, two of them rough, {args.rounds} rounds a method",
        [
            dict(zip(headings, (each.name, each.found, each.both, each.duration.written(".1f", ".1f")), strict=True))
            for each in outcomes
        ],
        "Shares with 90 % intervals, times as median and 5 to 95 %. The operator practises on the catalogue's training "
        "objects, on which the shipped models are trained, and plays with stones new to both. The paper's teams are "
        "people with a robot, who also moved an arm and fetched the stone.",
    ]
    output.show(
        [*paper, *({**asdict(each), "task": each.duration.value} for each in outcomes)], parts, as_json=args.json
    )
