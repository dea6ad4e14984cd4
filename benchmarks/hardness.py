"""Is the simulated data set hard in the paper's way? Prints docs/simulator-realism.md's first tables.

    python benchmarks/hardness.py DIR [--split leave-one-pressure-out]

DIR is what `tactophone simulate dataset DIR --objects all --seconds 5` makes.
"""

import argparse
import sys
from dataclasses import replace
from pathlib import Path

from tactophone.benchmark.crossvalidation import default_cache
from tactophone.benchmark.dataset_difficulty import RECALL, measure_hardness
from tactophone.benchmark.paper_methods import PaperMethod
from tactophone.dataset import open_dataset
from tactophone.training.network.recipe import paper
from tactophone.training.network.training_job import TrainingJob

BRIEF = {"hop": 64, "batch_size": 500, "least_steps": 0, "learning_rate": 5e-4}
"""The paper's recipe in a hurry, about 10 s a fold: the score is flat from there on (docs/training.md)."""


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--split", default="5-fold", help="or leave-one-pressure-out, leave-one-scenario-out")
    args = parser.parse_args()
    dataset = open_dataset(args.folder)
    methods = [PaperMethod(TrainingJob(replace(paper(variant), **BRIEF))) for variant in ("general", "one-channel")]
    found = measure_hardness(
        dataset,
        methods,
        by=args.split,
        cache=default_cache(),
        report=lambda name: print(f"judging: {name}", file=sys.stderr),
    )
    print(f"| method | balanced accuracy | AUC | false positives at {RECALL:.0%} rough recall |")
    print("|---|---|---|---|")
    for row in found.rows:
        print(f"| {row.name} | {row.balanced_accuracy} | {row.auc} | {row.false_positives} |")
    print(f"\nTwo channels less one, false positives at {RECALL:.0%} recall, drawn in pairs: {found.difference}")
    for label, level in found.air_over_contact_db.items():
        print(f"Air over contact, {label}: {level.value:.1f} dB ({level.low:.1f} to {level.high:.1f})")


if __name__ == "__main__":
    main()
