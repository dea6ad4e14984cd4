"""What the operator's finger gets of simulated objects, by take, with intervals over
objects; SIMULATED.

    tactophone simulate dataset build/random-pad --objects random:48:7 \\
      --takes long_medium,short_light,wiggle --seconds 6 --seed 77
    python benchmarks/rendered_objects.py build/random-pad --model texture

A row for each kind of take and one for all: shares of true contact as rendered, contact
gate and decision rule inside. *Order*: of a rough and a smooth object, how often the
rough one has the higher mean log odds in takes of the same kind. *Rough out of contact*
is the share of the time without contact in which rough is rendered. A second table says
how long after the first slide of a touch on a rough object rough is felt, over all
touches; one on which it never is counts as infinite.

`--save` keeps the counts of each object; `--beside` compares with such a file, object
by object: the gain and its 90 % interval over objects.
"""

import argparse
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from cells import in_ms
from tactophone.core.types import Touch
from tactophone.signal.perception.decision import DecisionRule
from tactophone.signal.perception.model_file import read_model
from tactophone.signal.perception.models import model_path
from tactophone_lab.datasets.open import open_dataset
from tactophone_lab.evaluation.bumps_and_delays import (
    Delays,
    contact_delays,
    decided_touches,
)
from tactophone_lab.evaluation.metrics import log_odds
from tactophone_lab.evaluation.predict import (
    TakePredictions,
    recording_predictor,
    true_contact,
)

RUB = "a rub without pauses"

KINDS = {
    "long_medium": "long strokes",
    "short_light": "short light strokes",
    "wiggle": RUB,
}
"""What the takes of a set are called in the table."""

COLUMNS = (
    "right, balanced",
    "rough as rough",
    "smooth as smooth",
    "smooth as rough",
    "gaps",
)
"""Shares of true contact that the tables print."""

DRAWS = 2000
"""Bootstrap draws of objects."""

LARGEST_LOGIT = 9.0
"""Log odds of one window are cut here, so that no single window decides an order."""

Counts = NDArray[np.float64]


@dataclass
class ObjectCounts:
    """Updates of one object in takes of one kind."""

    rough: bool
    rendered: Counts = field(default_factory=lambda: np.zeros(len(Touch)))
    """In true contact, by what is rendered."""
    outside: Counts = field(default_factory=lambda: np.zeros(len(Touch)))
    """Out of contact, by what is rendered."""
    log_odds: list[float] = field(default_factory=list)
    """Mean of each take over true contact where the gate is open."""
    delays: list[float] = field(default_factory=list)
    """Seconds from the first slide of each touch to rough, of a rough object."""
    missed: int = 0
    """Touches of a rough object on which rough is never felt."""


Table = dict[str, dict[str, ObjectCounts]]
"""By kind of take, then by object."""


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("dataset", type=Path, help="a set of `tactophone simulate`")
    parser.add_argument("--model", default="texture", help="%(default)s if omitted")
    parser.add_argument("--save", type=Path, metavar="FILE", help="keep the counts")
    parser.add_argument(
        "--beside", type=Path, metavar="FILE", help="counts to compare with"
    )
    args = parser.parse_args()
    before = read_table(args.beside) if args.beside else None
    table = count(args.dataset, args.model)
    print_scores(table)
    if before is not None:
        print_gains(table, before)
    if args.save:
        write_table(args.save, table)


def count(dataset: Path, name: str) -> Table:
    """Run a model over a set and count what is rendered."""
    model = read_model(model_path(name))
    predict = recording_predictor(model)
    table: Table = {}
    for recording in open_dataset(dataset).labelled().recordings:
        take = predict(recording)
        kind = KINDS.get(recording.take, recording.take)
        objects = table.setdefault(kind, {})
        counts = objects.setdefault(
            recording.surface, ObjectCounts(rough=bool(recording.rough))
        )
        add_take(counts, take, model.card.decision)
    return table


def add_take(counts: ObjectCounts, take: TakePredictions, rule: DecisionRule) -> None:
    rendered = decided_touches(take, rule)
    touching = true_contact(take)
    counts.rendered += np.bincount(rendered[touching], minlength=len(Touch))
    counts.outside += np.bincount(rendered[~touching], minlength=len(Touch))
    if counts.rough:
        # To the end of the window that decides.
        delays = contact_delays([take], rule, latency=0)
        counts.delays += delays.times.tolist()
        counts.missed += delays.missed
    heard = touching & take.contact
    if heard.any():
        odds = log_odds(take.probabilities[heard])
        counts.log_odds.append(
            float(np.clip(odds, -LARGEST_LOGIT, LARGEST_LOGIT).mean())
        )


def merged(table: Table) -> dict[str, ObjectCounts]:
    """Sum the kinds of takes of each object."""
    found: dict[str, ObjectCounts] = {}
    for objects in table.values():
        for name, counts in objects.items():
            total = found.setdefault(name, ObjectCounts(counts.rough))
            total.rendered += counts.rendered
            total.outside += counts.outside
            total.log_odds += counts.log_odds
            total.delays += counts.delays
            total.missed += counts.missed
    return found


def strokes(table: Table) -> Table:
    """All kinds but the rub without pauses."""
    return {kind: objects for kind, objects in table.items() if kind != RUB}


def views(table: Table) -> dict[str, dict[str, ObjectCounts]]:
    """The rows of the tables, by name."""
    rows = dict(table)
    if len(strokes(table)) > 1:
        rows["strokes, both"] = merged(strokes(table))
    rows["all"] = merged(table)
    return rows


def shares(counts: Counts) -> Mapping[str, Counts]:
    """Scores of counts ``(..., objects, label, rendered)``, summed over objects."""
    total = counts.sum(axis=-3)
    with np.errstate(invalid="ignore", divide="ignore"):
        by_label = total / total.sum(axis=-1, keepdims=True)
        gaps = total[..., Touch.NONE].sum(axis=-1) / total.sum(axis=(-2, -1))
    smooth, rough = by_label[..., 0, Touch.SMOOTH], by_label[..., 1, Touch.ROUGH]
    return {
        "right, balanced": (smooth + rough) / 2,
        "rough as rough": rough,
        "smooth as smooth": smooth,
        "smooth as rough": by_label[..., 0, Touch.ROUGH],
        "gaps": gaps,
    }


def stacked(objects: Mapping[str, ObjectCounts], names: Sequence[str]) -> Counts:
    """Counts of these objects, of shape ``(objects, label, rendered)``."""
    array = np.zeros((len(names), 2, len(Touch)))
    for row, name in zip(array, names, strict=True):
        row[int(objects[name].rough)] = objects[name].rendered
    return array


def draw(objects: Mapping[str, ObjectCounts], names: Sequence[str]) -> NDArray[np.intp]:
    """Draw objects with replacement, rough and smooth apart; shape ``(draws,
    objects)``."""
    rng = np.random.default_rng(0)
    drawn = []
    for label in (False, True):
        members = np.flatnonzero([objects[name].rough == label for name in names])
        drawn.append(rng.choice(members, (DRAWS, len(members))))
    return np.concatenate(drawn, axis=1)


def order(objects: Mapping[str, ObjectCounts]) -> float:
    """Share of pairs in which the rough object has the higher mean log odds."""
    by_label: list[list[float]] = [[], []]
    for counts in objects.values():
        if counts.log_odds:
            by_label[int(counts.rough)].append(float(np.mean(counts.log_odds)))
    if not all(by_label):
        return float("nan")
    smooth, rough = map(np.array, by_label)
    return float((rough[:, None] > smooth[None]).mean())


def print_scores(table: Table) -> None:
    print(f"| take | objects | {' | '.join(COLUMNS)} | order | rough out of contact |")
    print(f"|---|--:{'|--:' * (len(COLUMNS) + 2)}|")
    for kind, objects in views(table).items():
        names = sorted(objects)
        array = stacked(objects, names)
        values = shares(array)
        drawn = shares(array[draw(objects, names)])
        cells = []
        for column in COLUMNS:
            low, high = np.nanpercentile(drawn[column], [5, 95])
            cells.append(f"{values[column]:.3f} ({low:.3f}-{high:.3f})")
        outside = np.sum([counts.outside for counts in objects.values()], axis=0)
        rough_outside = outside[Touch.ROUGH] / max(outside.sum(), 1)
        print(
            f"| {kind} | {len(names)} | {' | '.join(cells)} | {order(objects):.3f} | "
            f"{rough_outside:.4f} |"
        )
    print_delays(table)


def print_delays(table: Table) -> None:
    print("\n| time to rough | touches | p50 | p95 | never |\n|---|--:|--:|--:|--:|")
    for kind, objects in views(table).items():
        every = Delays(
            np.array([delay for counts in objects.values() for delay in counts.delays]),
            sum(counts.missed for counts in objects.values()),
        )
        print(
            f"| {kind} | {len(every.times) + every.missed} | "
            f"{in_ms(every.quantile_ms(0.5))} | {in_ms(every.quantile_ms(0.95))} | "
            f"{every.missed} |"
        )


def print_gains(table: Table, before: Table) -> None:
    print(f"\n| gain | {' | '.join(COLUMNS)} |\n|---{'|--:' * len(COLUMNS)}|")
    earlier = views(before)
    for kind, objects in views(table).items():
        names = sorted(set(objects) & set(earlier.get(kind, {})))
        if not names:
            continue
        arrays = (stacked(objects, names), stacked(earlier[kind], names))
        drawn = draw(objects, names)
        new, old = (shares(array) for array in arrays)
        new_drawn, old_drawn = (shares(array[drawn]) for array in arrays)
        cells = []
        for column in COLUMNS:
            gain = new[column] - old[column]
            low, high = np.nanpercentile(new_drawn[column] - old_drawn[column], [5, 95])
            cells.append(f"{gain:+.3f} ({low:+.3f} to {high:+.3f})")
        print(f"| {kind} | {' | '.join(cells)} |")


def write_table(path: Path, table: Table) -> None:
    path.write_text(
        json.dumps(
            {
                kind: {
                    name: {
                        "rough": counts.rough,
                        "rendered": counts.rendered.tolist(),
                        "outside": counts.outside.tolist(),
                        "log_odds": counts.log_odds,
                        "delays": counts.delays,
                        "missed": counts.missed,
                    }
                    for name, counts in objects.items()
                }
                for kind, objects in table.items()
            }
        )
    )


def read_table(path: Path) -> Table:
    return {
        kind: {
            name: ObjectCounts(
                counts["rough"],
                np.array(counts["rendered"]),
                np.array(counts["outside"]),
                counts["log_odds"],
                counts["delays"],
                counts["missed"],
            )
            for name, counts in objects.items()
        }
        for kind, objects in json.loads(path.read_text()).items()
    }


if __name__ == "__main__":
    main()
