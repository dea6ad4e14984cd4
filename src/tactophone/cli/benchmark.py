"""``tactophone benchmark``: every method on the same splits; a table, a JSON file and a page with figures."""

import argparse
import json
import math
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.box import SIMPLE
from rich.table import Table

from tactophone.benchmark.crossvalidation import Cache, default_cache
from tactophone.cli._support import terminal
from tactophone.cli._support.dataset_options import add_choice, choose
from tactophone.cli.train import prepare_torch
from tactophone.dataset import Dataset
from tactophone.errors import ConfigError

if TYPE_CHECKING:
    from tactophone.benchmark.entries import Cost
    from tactophone.benchmark.plan import Findings, Plan
    from tactophone.benchmark.result import Result

FAST_SECONDS, FAST_SEED = 3.0, 5
"""Of the simulated takes that ``--fast`` makes where no data is given."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the verb's arguments."""
    parser.add_argument(
        "--data", type=Path, action="append", default=[], metavar="DIR",
        help="a data set, repeatable; each is scored by itself, real and simulated sound never mixed. Without it: a "
        "small simulated one, made on the spot",
    )  # fmt: skip
    add_choice(parser)
    parser.add_argument("--methods", metavar="LIST", help="names divided by commas (default: all)")
    parser.add_argument(
        "--splits", metavar="LIST",
        help="names divided by commas, as `evaluate --split` takes them (default: by surface, and by stroke, pressure, "
        "scenario and session where the data tells them)",
    )  # fmt: skip
    parser.add_argument("--fast", action="store_true", help="three folds by surface alone: minutes, not hours")
    parser.add_argument(
        "--out", type=Path, default=Path("benchmark"), metavar="DIR", help="for results.json, report.html"
    )
    parser.add_argument("--workers", type=int, default=2, metavar="N", help="processes, 1 or more")
    parser.add_argument("--ray", action="store_true", help="run folds on a Ray cluster: RAY_ADDRESS, or a local one")
    parser.add_argument("--cache", type=Path, metavar="DIR", help="where folds' results are kept (default: the user's)")
    parser.add_argument("--table1", action="store_true", help="print Table I beside the paper's; authors' layout")
    parser.add_argument("--table2", action="store_true", help="print Table II beside the paper's; authors' layout")
    parser.add_argument("--table3", action="store_true", help="print the task, by a simulated operator")
    parser.add_argument("--rounds", type=int, default=1000, metavar="N", help="rounds of the task a method, 1 or more")
    parser.add_argument("--json", action="store_true", help="print JSON instead of tables")


def run(args: argparse.Namespace) -> int:
    """Run, score and report."""
    if args.workers < 1 or args.rounds < 1:
        raise ConfigError(f"--workers {args.workers}, --rounds {args.rounds}: 1 or more of each")
    prepare_torch()
    cache = Cache(args.cache) if args.cache else default_cache()
    if args.table1 or args.table2 or args.table3:
        return _print_tables(args, cache)
    from tactophone.benchmark.entries import measure_costs

    findings: list[Findings] = []
    costs: dict[str, dict[str, Cost]] = {}
    for dataset in _datasets(args, cache):
        plan = _plan(dataset, args)
        findings.append(_run(plan, cache, args))
        names = [one.name for one in plan.contenders if not one.control]
        costs[dataset.name] = measure_costs(dataset, names, cache.folder / "costs")
    told = _told(findings, costs)
    _write(args.out, told, findings, costs)
    if args.json:
        terminal.print_json(told)
        return 0
    _show(findings, costs)
    terminal.log().print(f"{args.out / 'report.html'}, {args.out / 'results.json'}")
    return 0


def _datasets(args: argparse.Namespace, cache: Cache) -> list[Dataset]:
    folders = args.data or [_simulated(cache.folder / "simulated", args.workers)]
    return [choose(folder, args.where) for folder in folders]


def _simulated(folder: Path, workers: int) -> Path:
    """Make a small simulated set, once."""
    from tactophone.simulation import TAKES
    from tactophone.simulation.content.catalogue import catalogue
    from tactophone.simulation.content.generate import Style, finish, make, plan

    takes = [take for take in TAKES if take.name in ("long_medium", "short_light", "wiggle")]
    things = [thing for thing in catalogue() if thing.number >= 0]
    jobs = plan(things, Style(duration=FAST_SECONDS, seed=FAST_SEED), takes=takes)
    with terminal.progress("simulating") as bar:
        for _ in bar.track(make(folder, jobs, processes=workers), total=len(jobs), task_id=bar.add_task("", note="")):
            pass
    finish(folder, jobs)
    return folder


def _plan(dataset: Dataset, args: argparse.Namespace) -> "Plan":
    from tactophone.benchmark.entries import plan_for
    from tactophone.benchmark.plan import splits_of

    splits = tuple(args.splits.split(",")) if args.splits else splits_of(dataset, fast=args.fast)
    return plan_for(dataset, args.methods.split(",") if args.methods else (), splits)


def _run(plan: "Plan", cache: Cache, args: argparse.Namespace) -> "Findings":
    from tactophone.benchmark.plan import run_plan

    place = "ray" if args.ray else "processes" if args.workers > 1 else "here"
    with terminal.progress(plan.dataset.name) as bar:
        task = bar.add_task("", total=None, note="")

        def show(done: int, of: int, name: str) -> None:
            bar.update(task, completed=done, total=of, note=name)

        return run_plan(plan, cache, place=place, workers=args.workers, report=show)  # type: ignore[arg-type]


def _told(findings: Sequence["Findings"], costs: dict[str, dict[str, "Cost"]]) -> dict[str, Any]:
    from tactophone.benchmark.page import steps_by_profile

    return {
        "datasets": [one.as_json() for one in findings],
        "costs": {dataset: {name: asdict(cost) for name, cost in some.items()} for dataset, some in costs.items()},
        "profiles": steps_by_profile(),
    }


def _write(
    folder: Path, told: dict[str, Any], findings: Sequence["Findings"], costs: dict[str, dict[str, "Cost"]]
) -> None:
    from tactophone.benchmark.page import write_page

    folder.mkdir(parents=True, exist_ok=True)
    (folder / "results.json").write_text(json.dumps(terminal.finite(told), indent=1))
    notes = (
        "Each table is of one data set and one split; every recording was judged by a model that never met its side. "
        "Intervals: 90 % of bootstrap draws of the surfaces. p: paired bootstrap against the first method.",
        "Scores are of updates while the finger truly touches, whatever a method's own contact gate says; bumps and "
        "delays are as felt, with the gate. Controls are there to distrust the rest by: one, in italics, hears only "
        "what no surface can have said; the other learns and is scored on labels dealt anew over the surfaces, so that "
        "what it has over 0.5 is knowing surfaces again, not roughness.",
    )
    (folder / "report.html").write_text(write_page(findings, costs=costs, notes=notes), encoding="utf-8")


def _show(findings: Sequence["Findings"], costs: dict[str, dict[str, "Cost"]]) -> None:
    from tactophone.benchmark.page import steps_by_profile, told_dealt, told_heights

    for one in findings:
        for split in dict.fromkeys(result.split for result in one.results):
            terminal.out().print(f"{one.dataset} ({one.origin}), {split}", _table_of(one, split, costs))
            if split in one.dealt:
                terminal.out().print(f"control, labels dealt anew: {told_dealt(one.dealt[split])}")
            if split in one.heights:
                terminal.out().print(told_heights(one.heights[split]))
            _show_goals([result for result in one.results if result.split == split], costs.get(one.dataset, {}))
            terminal.out().print()
    steps = ", ".join(f"{name} {pitch:.1f} / {both:.1f}" for name, (pitch, both) in steps_by_profile().items())
    terminal.out().print(f"steps that a finger tells apart from smooth to rough, of frequency / with level: {steps}")


def _show_goals(results: Sequence["Result"], costs: dict[str, "Cost"]) -> None:
    from tactophone.benchmark.goals import goals_of, tell

    if not (goals := goals_of(results, costs)):
        return
    table = Table("ours set out to reach", box=SIMPLE, pad_edge=False, padding=(0, 1, 0, 0))
    for name in (results[0].method, "ours", "at most", ""):
        table.add_column(name, justify="right")
    for one in goals:
        table.add_row(one.told, tell(one.reference), tell(one.ours), tell(one.limit), one.verdict)
    terminal.out().print(table)


def _table_of(found: "Findings", split: str, costs: dict[str, dict[str, "Cost"]]) -> Table:
    """What 80 characters hold; the page has the rest."""
    table = Table("method", "balanced accuracy", box=SIMPLE, pad_edge=False, padding=(0, 1, 0, 0))
    for name in ("AUC", "at 1 %", "bumps/min", "edge (ms)", "us"):
        table.add_column(name, justify="right")
    for one in (one for one in found.results if one.split == split):
        scores, cost = one.scores["two-class"], costs.get(found.dataset, {}).get(one.method)
        middle, late, _ = one.edge_ms
        table.add_row(
            one.method.removeprefix("control: "), str(scores["balanced_accuracy"]), f"{scores['auc'].value:.3f}",
            f"{scores['recall_at_1'].value:.2f}", f"{one.bumps_per_minute:.1f}",
            f"{middle:.0f} / {late:.0f}" if math.isfinite(middle) else "-", f"{cost.update_us:.0f}" if cost else "",
        )  # fmt: skip
    return table


def _print_tables(args: argparse.Namespace, cache: Cache) -> int:
    from tactophone.cli._support.paper_tables import print_tables

    return print_tables(args, _datasets(args, cache) if args.table1 or args.table2 else [], cache)
