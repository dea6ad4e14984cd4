"""``tactophone benchmark``: every method on the same splits; a table, a JSON file and a report with figures."""

import argparse
import json
import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.box import SIMPLE
from rich.table import Table

from tactophone.cli import options, output
from tactophone.cli.data import add_filter, add_folds, add_kin, cache_of, open_filtered
from tactophone.cli.options import Within
from tactophone.dataset.values import Dataset

if TYPE_CHECKING:
    from tactophone.benchmark.folds import Cache
    from tactophone.benchmark.paper_tables import TableRow, TaskOutcome
    from tactophone.benchmark.results import Cost, DatasetResults
    from tactophone.evaluation.bootstrap import Estimate
    from tactophone.evaluation.predict import TakePredictions

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


EXAMPLES = (
    "tactophone benchmark --fast",
    "tactophone benchmark --data recordings --methods texture,level --splits 4-fold",
    "tactophone benchmark --table3 --rounds 100",
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
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
    add_folds(parser)
    parser.add_argument("--table1", action="store_true", help="print Table I beside the paper's; authors' layout")
    parser.add_argument("--table2", action="store_true", help="print Table II beside the paper's; authors' layout")
    parser.add_argument(
        "--table3", action="store_true",
        help="print the paper's task with a simulated operator; --methods also takes paths of model files",
    )  # fmt: skip
    parser.add_argument(
        "--ablations", type=Path, metavar="DIR",
        help="score the paper's network by each recipe file in DIR, on the first of --splits (default: 3-fold by kin)",
    )  # fmt: skip
    parser.add_argument("--rounds", type=Within(int, 1), default=1000, metavar="N", help="rounds of the task, %(type)s")
    options.add_json(parser, "print JSON instead of tables")


def run(args: argparse.Namespace) -> int:
    from tactophone.benchmark.plan import measure_costs
    from tactophone.benchmark.report import steps_by_profile, write_report

    cache = cache_of(args)
    if args.table1 or args.table2 or args.table3:
        return print_tables(args, _datasets(args, cache) if args.table1 or args.table2 else [], cache)
    if args.ablations:
        return _print_ablations(args, cache)
    output.make_folder(args.out)  # now, not after hours
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
    (args.out / "results.json").write_text(json.dumps(output.finite(summary), indent=1))
    report = write_report(args.out, results, costs=costs, notes=NOTES)
    output.show(Benchmark(results, costs, summary), as_json=args.json)
    if args.json:
        return 0
    output.log().print(f"{report}, {args.out / 'results.json'}")
    return 0


def _print_ablations(args: argparse.Namespace, cache: "Cache") -> int:
    from tactophone.benchmark.paper_tables import ablation_rows, ablations_in
    from tactophone.benchmark.plan import origin_of

    methods = ablations_in(args.ablations)
    for dataset in _datasets(args, cache):
        name = args.splits.split(",")[0] if args.splits else "3-fold"
        with output.progress("ablations", len(methods)) as update:
            rows = ablation_rows(methods, dataset, name, cache, report=lambda done, of: update(completed=done, note=of))
        title = f"The paper's network and what its authors tried, {dataset.name} ({origin_of(dataset)}), {name}"
        output.show(Ablations(title, rows), as_json=args.json)
    return 0


@dataclass(frozen=True, slots=True)
class Ablations:
    """The scores of the paper's network with one choice undone at a time."""

    title: str
    lines: "Sequence[TableRow]"

    def parts(self) -> Iterator[output.Part]:
        yield self.title
        yield [{"network": row.name, **{name: str(value) for name, value in row.values.items()}} for row in self.lines]
        yield "Windows in true contact, two-class rule; 90 % intervals over surfaces."


def _datasets(args: argparse.Namespace, cache: "Cache") -> list[Dataset]:
    folders = args.data or [_simulated(cache.folder / "simulated", args.workers)]
    return [open_filtered(folder, args.filter, kin=args.kin) for folder in folders]


def _simulated(folder: Path, workers: int) -> Path:
    from tactophone.simulation.catalogue import catalogue
    from tactophone.simulation.render import RenderOptions, plan_dataset, render_dataset, write_manifest
    from tactophone.simulation.takes import TAKES

    takes = [take for take in TAKES if take.name in ("long_medium", "short_light", "wiggle")]
    objects = [obj for obj in catalogue() if obj.number >= 0]
    jobs = plan_dataset(objects, RenderOptions(duration=FAST_SECONDS, seed=FAST_SEED), takes=takes)
    with output.tracked(render_dataset(folder, jobs, processes=workers), "simulating", len(jobs)) as rendered:
        for _ in rendered:
            pass
    write_manifest(folder, jobs)
    return folder


def _run(dataset: Dataset, cache: "Cache", args: argparse.Namespace) -> "DatasetResults":
    from tactophone.benchmark.plan import plan_for, run_plan, splits_of

    splits = args.splits.split(",") if args.splits else splits_of(dataset, fast=args.fast)
    plan = plan_for(dataset, args.methods.split(",") if args.methods else (), splits, fast=args.fast)
    with output.progress(dataset.name) as update:
        return run_plan(
            plan, cache, workers=args.workers, ray=args.ray,
            report=lambda done, of, name: update(completed=done, total=of, note=name),
        )  # fmt: skip


@dataclass(frozen=True, slots=True)
class Benchmark:
    """The scores and costs of every data set, and what `results.json` holds of them."""

    results: "Sequence[DatasetResults]"
    costs: "dict[str, dict[str, Cost]]"
    summary: dict[str, Any]

    def as_json(self) -> dict[str, Any]:
        return self.summary

    def parts(self) -> Iterator[output.Part]:
        from tactophone.benchmark.report import notes_of, steps_by_profile

        for of_dataset in self.results:
            for split in dict.fromkeys(result.split for result in of_dataset.results):
                yield f"{of_dataset.dataset} ({of_dataset.origin}), {split}"
                yield _table_of(of_dataset, split, self.costs.get(of_dataset.dataset, {}))
                yield from notes_of(of_dataset, split)
                yield ""
        steps = ", ".join(f"{name} {pitch:.1f} / {both:.1f}" for name, (pitch, both) in steps_by_profile().items())
        yield f"just-noticeable steps from smooth to rough, of frequency / with level: {steps}"


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


def print_tables(args: argparse.Namespace, datasets: Sequence[Dataset], cache: "Cache") -> int:
    """Print the tables that ``args`` names; I and II of each data set."""
    from tactophone.benchmark.paper_tables import by_gate, table_one, table_two
    from tactophone.benchmark.plan import origin_of

    for dataset in datasets:
        predictions = _predict(dataset, args.methods.split(",") if args.methods else (), cache)
        for gate, gated in by_gate(predictions, dataset.recordings).items():
            for chosen, make, title in ((args.table1, table_one, "Table I"), (args.table2, table_two, "Table II")):
                if chosen:
                    heading = f"{title}, {dataset.name} ({origin_of(dataset)}), {gate}"
                    print_rows(heading, make(gated), as_json=args.json)
    if args.table3:
        _print_task(args)
    return 0


def _predict(dataset: Dataset, names: Sequence[str], cache: "Cache") -> "dict[str, list[TakePredictions]]":
    from tactophone.benchmark.paper_tables import predict_held_out

    with output.progress("Tables I and II") as update:
        return predict_held_out(dataset, names, cache, report=lambda name: update(note=name))


def print_rows(title: str, rows: Sequence["TableRow"], *, as_json: bool) -> None:
    output.show(PaperTable(title, rows), as_json=as_json)


@dataclass(frozen=True, slots=True)
class PaperTable:
    """One of the paper's Tables I and II."""

    title: str
    lines: "Sequence[TableRow]"

    def parts(self) -> Iterator[output.Part]:
        yield _paper_table(self.title, self.lines)


def _paper_table(title: str, rows: "Sequence[TableRow]") -> Table:
    caption = (
        "Below a score, its 90 % interval over takes of the test objects and 5 s pieces of the competition's runs: one "
        "object a class says nothing of other objects."
    )
    table = Table(title=title, title_justify="left", box=SIMPLE, pad_edge=False, padding=0)
    table.caption, table.caption_justify = caption, "left"
    table.add_column("")
    for name in rows[0].values:
        # In 80 characters the headings wrap, the figures and the names' words do not.
        lines = [line for row in rows for line in _cell(row.values[name]).splitlines()]
        table.add_column(name.replace("_", " "), justify="right", width=max(map(len, ("contact", *lines))))
    for row in rows:
        table.add_row(row.name, *map(_cell, row.values.values()))
    return table


def _cell(score: "Estimate") -> str:
    if math.isnan(score.low):
        return "-" if math.isnan(score.value) else f"{score.value:.3f}"
    # Two lines, and no leading zeros, so that eight columns fit.
    low, high = (f"{end:.2f}".removeprefix("0") for end in (score.low, score.high))
    return f"{score.value:.3f}\n{low}-{high}"


def _print_task(args: argparse.Namespace) -> None:
    from tactophone.benchmark.paper_tables import PAPER_THREE, play_task, task_methods

    names = args.methods.split(",") if args.methods else task_methods()
    with output.progress("simulated operator", len(names) + 1) as update:
        outcomes = play_task(names, rounds=args.rounds, report=lambda name: update(advance=1, note=name))
    output.show(OperatorTask(PAPER_THREE, outcomes, args.rounds), as_json=args.json)


@dataclass(frozen=True, slots=True)
class OperatorTask:
    """The paper's task: its times by team and day, and how the simulated operator fared in so many rounds."""

    paper: "Mapping[str, tuple[int | None, int | None]]"
    outcomes: "Sequence[TaskOutcome]"
    rounds: int

    def as_json(self) -> list[dict[str, Any]]:
        own: list[dict[str, Any]] = [
            {"name": f"paper's own: {team}, day {day}", "task": time}
            for team, times in self.paper.items()
            for day, time in enumerate(times, 1)
        ]
        played = [{**asdict(each), "task": each.median_duration} for each in self.outcomes]
        return [*own, *played]

    def parts(self) -> Iterator[output.Part]:
        yield "Table III as the paper has it: min:s until a rough stone was fetched; N/A: not attempted"
        yield [
            {"team": team, **{f"day {day}": _minutes(time) for day, time in enumerate(times, 1)}}
            for team, times in self.paper.items()
        ]
        yield _task_table(self)


def _minutes(time: int | None) -> str:
    return "N/A" if time is None else f"{time // 60}:{time % 60:02}"


def _task_table(task: OperatorTask) -> Table:
    title = f"Table III: SIMULATED OPERATOR, five stones, two of them rough, {task.rounds} rounds a method"
    caption = (
        "Shares with 90 % intervals, times as median and 5 to 95 %. The operator practises on the catalogue's training "
        "objects, on which the shipped models are trained, and plays with stones new to both. The paper's teams are "
        "people with a robot, who also moved an arm and fetched the stone."
    )
    heading = ("method", "rough one found", "both found", "decision time (s)")
    table = Table(*heading, title=title, title_justify="left", caption=caption, caption_justify="left")
    for outcome in task.outcomes:
        table.add_row(outcome.name, outcome.found, outcome.both, outcome.duration)
    return table
