"""What the default model renders of the frozen objects under the printed finger, by
silicone and by tilt.

    python benchmarks/printed_pad.py

The bed's stiffness follows from the printed dimensions (``hardware/dimensions.py``) and
the silicone's modulus, which follows from the data sheets' stress at 100 % strain, 55,
69, 152 and 338 kPa, of a neo-Hookean silicone. Pad, ring and disc weigh 2 g, with a
ring of brass 5 g, in place of 6. Loss factors stay. The bed leans by 30 degrees, so
that a finger with its tip 30 degrees down presses along the bed's axis, and one that
lies flat, or stands at 60 degrees, 30 degrees from it.
"""

import argparse
import importlib.util
import sys
import tempfile
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType

from tactophone.core.tips import DEFAULT_TIP
from tactophone.signal.perception.model_file import read_model
from tactophone.signal.perception.models import model_path
from tactophone_lab.app.evaluate import recording_predictor
from tactophone_lab.datasets.open import open_dataset
from tactophone_lab.evaluation.scores import make_report
from tactophone_lab.simulation import finger
from tactophone_lab.simulation.catalogue import catalogue
from tactophone_lab.simulation.render import (
    RenderOptions,
    plan_dataset,
    render_dataset,
    write_manifest,
)
from tactophone_lab.simulation.takes import TAKES

QUIET = ("long_medium", "short_light", "wiggle")
SILICONE = {
    "Shore 00-10": 0.095e6,
    "Shore 00-30": 0.12e6,
    "Shore 10 A": 0.26e6,
    "Shore 20 A": 0.58e6,
}
"""Young's modulus in Pa."""

PRINTED = 2e-3
"""Mass in kg of pad, ring and disc, with a printed ring."""

BRASS = 5e-3
"""Mass in kg of pad, ring and disc, with a ring cut from brass tube."""

LEAN = 30.0
"""Of the printed bed, in degrees."""

ROWS = [
    ("Shore 00-30", LEAN, BRASS),
    ("Shore 00-30", 0.0, BRASS),  # as at 60: 30 degrees from the bed's axis
    ("Shore 00-30", LEAN, PRINTED),
    ("Shore 00-30", 0.0, PRINTED),
    *((name, LEAN, BRASS) for name in ("Shore 10 A", "Shore 20 A", "Shore 00-10")),
    *((None, tilt, 0.0) for tilt in (0.0, 30.0, 60.0)),
]
"""Bed, tilt of the finger in degrees, tip down, and mass. Without a bed, the pad lies
on the flat one of training."""

TRAINED = finger.TIPS[DEFAULT_TIP]


def printed(modulus: float, mass: float) -> finger.Tip:
    """Return the default tip on the printed bed."""
    hardware = Path(__file__).parents[1] / "hardware" / "dimensions.py"
    spec = importlib.util.spec_from_file_location("dimensions", hardware)
    assert spec is not None
    assert spec.loader is not None
    dimensions = sys.modules["dimensions"] = importlib.util.module_from_spec(spec)
    spec.loader.exec_module(dimensions)
    bed, parts = dimensions.FingerDimensions(), TRAINED.finger
    along, across = bed.bed_stiffness * modulus, bed.bed_shear * modulus
    lighter = mass / parts.pad_mass
    parts = parts._replace(
        pad_mass=mass,
        pad_stiffness=along,
        pad_damping=parts.pad_damping * (along / parts.pad_stiffness * lighter) ** 0.5,
        shear_stiffness=across,
        shear_damping=parts.shear_damping
        * (across / parts.shear_stiffness * lighter) ** 0.5,
    )
    return replace(TRAINED, finger=parts)


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--model", default="texture", help="%(default)s if omitted")
    args = parser.parse_args()
    model = read_model(model_path(args.model))
    predict, takes = (
        recording_predictor(model),
        [take for take in TAKES if take.name in QUIET],
    )
    print(
        "| bed | mass | tilt | right | smooth as rough | gaps | AUC "
        "|\n|---|--:|--:|--:|--:|--:|--:|"
    )
    for bed, tilt, mass in ROWS:
        tip = printed(SILICONE[bed], mass) if bed else TRAINED
        finger.TIPS = MappingProxyType({**finger.TIPS, DEFAULT_TIP: tip})
        lean = tilt - LEAN if bed else tilt
        jobs = plan_dataset(
            catalogue()[23:33],
            RenderOptions(duration=6.0, seed=31, tilt=abs(lean)),
            takes=takes,
        )
        with tempfile.TemporaryDirectory() as folder:
            list(render_dataset(Path(folder), jobs))
            write_manifest(Path(folder), jobs)
            takes_of_it = open_dataset(Path(folder)).recordings
            found = make_report(
                [predict(take) for take in takes_of_it], decision=model.card.decision
            )
        shown = found.rendered
        scores = (
            shown.balanced_accuracy,
            shown.smooth_as_rough,
            shown.gaps,
            found.rules["two-class"]["auc"],
        )
        print(
            f"| {bed or 'as in training'} | {1e3 * mass or 6:g} g | {tilt:g}° | "
            f"{' | '.join(map(str, scores))} |",
            flush=True,
        )


if __name__ == "__main__":
    main()
