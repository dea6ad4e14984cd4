"""What the default model renders of the frozen objects under the printed finger, by
silicone and by tilt.

    python benchmarks/printed_pad.py
    python benchmarks/printed_pad.py --sets FOLDER

The bed's stiffness follows from the printed dimensions (``hardware/dimensions.py``) and
the silicone's modulus, which follows from the data sheets' stress at 100 % strain, 55,
69, 152 and 338 kPa, of a neo-Hookean silicone. Pad, ring and disc weigh 1.6 g, with a
ring of brass 4.4 g, in place of 6. Loss factors stay. The bed leans by 30 degrees, so
that a finger with its tip 30 degrees down presses along the bed's axis, and one that
lies flat, or stands at 60 degrees, 30 degrees from it.

``--sets`` renders instead what ``models.mk`` renders for the training of ``texture``,
under the finger as drawn, and prints the command that trains on it; ``--model FILE``
then scores the file.
"""

import argparse
import importlib.util
import sys
import tempfile
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType

from tactophone.core.tips import DEFAULT_TIP
from tactophone.signal.perception.model_file import read_model
from tactophone.signal.perception.models import model_path
from tactophone_lab.datasets.open import open_dataset
from tactophone_lab.evaluation.predict import recording_predictor
from tactophone_lab.evaluation.scores import make_report
from tactophone_lab.simulation import finger
from tactophone_lab.simulation.built_finger import BuiltFinger
from tactophone_lab.simulation.catalogue import SimulatedObject, catalogue
from tactophone_lab.simulation.render import (
    RenderOptions,
    plan_dataset,
    render_dataset,
    write_manifest,
)
from tactophone_lab.simulation.takes import TAKES

QUIET = ("long_medium", "short_light", "wiggle")

IN_HALL = ("long_loud", "short_medium")

DURATION = 6.0
"""Seconds of a take."""

SILICONE = {
    "Shore 00-10": 0.095e6,
    "Shore 00-30": 0.12e6,
    "Shore 10 A": 0.26e6,
    "Shore 20 A": 0.58e6,
}
"""Young's modulus in Pa."""

PRINTED = 1.6e-3
"""Mass in kg of pad, ring and disc, with a printed ring."""

BRASS = BuiltFinger().pad
"""Mass in kg of pad, ring and disc, with a ring cut from brass tube."""

DRAWN = "Shore 00-30"
"""Silicone of the bed in the list of parts."""

LEAN = 30.0
"""Of the printed bed, in degrees."""

ROWS = [
    (DRAWN, LEAN, BRASS),
    (DRAWN, 0.0, BRASS),  # as at 60: 30 degrees from the bed's axis
    (DRAWN, LEAN, PRINTED),
    (DRAWN, 0.0, PRINTED),
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


def render(
    folder: Path,
    tip: finger.Tip,
    objects: Sequence[SimulatedObject],
    options: RenderOptions,
    takes: Sequence[str],
) -> None:
    """Render takes, by their names, of objects under a tip in the default one's
    place."""
    finger.TIPS = MappingProxyType({**finger.TIPS, DEFAULT_TIP: tip})
    chosen = [take for take in TAKES if take.name in takes]
    jobs = plan_dataset(objects, options, takes=chosen)
    list(render_dataset(folder, jobs))
    write_manifest(folder, jobs)


def render_training_sets(folder: Path) -> None:
    """Render the sets of ``models.mk`` under the finger as drawn, tip 30 degrees
    down."""
    tip = printed(SILICONE[DRAWN], BRASS)
    objects = catalogue()[:20] + catalogue()[33:44]
    quiet = RenderOptions(duration=DURATION, seed=21, gain_db=-12.0)
    render(folder / "train", tip, objects, quiet, QUIET)
    hall = replace(quiet, seed=24, hall=True)
    render(folder / "hall", tip, objects, hall, IN_HALL)
    print(
        f"tactophone train {folder / 'train'} --also {folder / 'hall'} --no-score "
        f"--recipe examples/recipes/texture.toml --out {folder / 'drawn.onnx'}"
    )


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--model", default="texture", help="%(default)s if omitted")
    parser.add_argument(
        "--seconds", type=float, default=DURATION, help="of a take (default: 6)"
    )
    parser.add_argument("--sets", type=Path, metavar="FOLDER", help="render to train")
    args = parser.parse_args()
    if args.sets is not None:
        render_training_sets(args.sets)
        return
    model = read_model(model_path(args.model))
    predict = recording_predictor(model)
    print(
        "| bed | pad, ring and disc | held at | right, balanced | smooth as rough "
        "| gaps | AUC of windows |"
    )
    print("|---|--:|--:|--:|--:|--:|--:|")
    for bed, tilt, mass in ROWS:
        tip = printed(SILICONE[bed], mass) if bed else TRAINED
        lean = tilt - LEAN if bed else tilt
        options = RenderOptions(duration=args.seconds, seed=31, tilt=abs(lean))
        with tempfile.TemporaryDirectory() as folder:
            render(Path(folder), tip, catalogue()[23:33], options, QUIET)
            takes = open_dataset(Path(folder)).recordings
            found = make_report(
                [predict(take) for take in takes], decision=model.card.decision
            )
        shown = found.rendered
        scores = (
            shown.balanced_accuracy,
            shown.smooth_as_rough,
            shown.gaps,
            found.windows["auc"],
        )
        print(
            f"| {bed or 'as in training'} | {1e3 * mass or 6:g} g | {tilt:g}° | "
            f"{' | '.join(map(str, scores))} |",
            flush=True,
        )


if __name__ == "__main__":
    main()
