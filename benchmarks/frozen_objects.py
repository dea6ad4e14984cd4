"""What the texture detector takes for rough on the ten frozen objects, at the recall of the paper's network.

    make sets && python benchmarks/frozen_objects.py build/sets/pad-test

Single windows in true contact, two-class rule, as `make scores`; *linoleum* is its share at the model's own threshold.
"""

import argparse
from pathlib import Path

from tactophone.dataset.read import open_dataset
from tactophone.evaluation.metrics import false_positives_at_recall, measure
from tactophone.evaluation.predict import in_true_contact, model_predictor, scores_of
from tactophone.perception.model_file import read_model
from tactophone.perception.models import model_path

REFERENCE = "paper"


def main() -> None:
    """Print a row for each model."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("dataset", type=Path, help="the frozen objects under the pad")
    recordings = open_dataset(parser.parse_args().dataset).labelled().recordings
    scores = {}
    for name in (REFERENCE, "texture"):
        predict = model_predictor(read_model(model_path(name)), own_floor=True)
        scores[name] = scores_of([in_true_contact(predict(take)) for take in recordings], "two-class")
    recall = measure(scores[REFERENCE])["rough_accuracy"]
    print(f"| smooth as rough | at {REFERENCE}'s recall of {recall:.3f} | at its own threshold | linoleum |")
    print("|---|--:|--:|--:|")
    for name, found in scores.items():
        linoleum = found.surface == found.names.index("linoleum")
        own = measure(found)["false_positive_rate"]
        rough = (found.score[linoleum] >= 0.5).mean()
        print(f"| {name} | {false_positives_at_recall(found, recall):.3f} | {own:.3f} | {rough:.3f} |")


if __name__ == "__main__":
    main()
