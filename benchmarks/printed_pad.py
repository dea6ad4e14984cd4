"""What the default model renders of the frozen objects under the printed pad, which differs from the simulated one.

    python benchmarks/printed_pad.py

The printed bed is stiffer than the simulated silicone of 12 kN/m: 1.5 mm, bonded to 12 x 18 mm on either side, takes
``E (1 + 2 S^2) A / t`` with the shape factor S = 2.4 (Gent, *Engineering with Rubber*, ch. 8). E follows from the data
sheets' stress at 100 % strain, 69, 152 and 338 kPa, of a neo-Hookean silicone. Printed pad and disc weigh 4 g in place
of 6. Loss factors stay.
"""

import argparse
import tempfile
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType

from tactophone.app.recordings import recording_predictor
from tactophone.core.types import DEFAULT_TIP
from tactophone.lab.dataset.read import open_dataset
from tactophone.lab.evaluation.report import make_report
from tactophone.lab.simulation import finger
from tactophone.lab.simulation.catalogue import catalogue
from tactophone.lab.simulation.render import RenderOptions, plan_dataset, render_dataset, write_manifest
from tactophone.lab.simulation.takes import TAKES
from tactophone.signal.perception.model_file import read_model
from tactophone.signal.perception.models import model_path

QUIET = ("long_medium", "short_light", "wiggle")
SILICONE = {"as in training": None, "Shore 00-30": 0.12e6, "Shore 10 A": 0.26e6, "Shore 20 A": 0.58e6}
"""Young's modulus in Pa."""

SHAPE_FACTOR, AREA, THICKNESS, MASS = 2.4, 2.16e-4, 1.5e-3, 4e-3
"""Of the printed bed, in m^2 and m; of what lies on it, in kg."""

FINGERS = [*((3e-3, name) for name in SILICONE), (16e-3, "as in training"), (16e-3, "Shore 10 A")]
"""Radius in m, and bed; the first is the finger of training."""

TRAINED = finger.TIPS[DEFAULT_TIP]


def printed(radius: float, modulus: float | None) -> finger.Tip:
    """Return the default tip with another radius and, with a modulus, on the printed bed."""
    parts = TRAINED.finger._replace(tip_radius=radius)
    if modulus:
        stiffer = modulus * (1 + 2 * SHAPE_FACTOR**2) * AREA / THICKNESS / parts.pad_stiffness
        damped = (stiffer * MASS / parts.pad_mass) ** 0.5
        parts = parts._replace(
            pad_mass=MASS,
            pad_stiffness=stiffer * parts.pad_stiffness,
            pad_damping=damped * parts.pad_damping,
            shear_stiffness=stiffer * parts.shear_stiffness,
            shear_damping=damped * parts.shear_damping,
        )
    return replace(TRAINED, finger=parts)


def main() -> None:
    argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter).parse_args()
    model = read_model(model_path("texture"))
    predict, takes = recording_predictor(model), [take for take in TAKES if take.name in QUIET]
    jobs = plan_dataset(catalogue()[23:33], RenderOptions(duration=6.0, seed=31), takes=takes)
    print("| radius | bed | right | smooth as rough | gaps | AUC |\n|--:|---|--:|--:|--:|--:|")
    for radius, bed in FINGERS:
        finger.TIPS = MappingProxyType({**finger.TIPS, DEFAULT_TIP: printed(radius, SILICONE[bed])})
        with tempfile.TemporaryDirectory() as folder:
            list(render_dataset(Path(folder), jobs))
            write_manifest(Path(folder), jobs)
            takes_of_it = open_dataset(Path(folder)).recordings
            found = make_report([predict(take) for take in takes_of_it], decision=model.card.decision)
        shown = found.rendered
        scores = (shown.balanced_accuracy, shown.smooth_as_rough, shown.gaps, found.rules["two-class"]["auc"])
        print(f"| {1e3 * radius:g} mm | {bed} | {' | '.join(map(str, scores))} |", flush=True)


if __name__ == "__main__":
    main()
