"""Rows of docs/reference/paper.md that no other command has; all of them on SIMULATED
sound of the pad.

    python benchmarks/paper_rows.py slips
    python benchmarks/paper_rows.py pressure general.onnx fine-tuned.onnx
    python benchmarks/paper_rows.py irregularities
    python benchmarks/paper_rows.py regularity

*slips*: the finger slips a hundred times off a smooth stone onto the mat. A slip
*bumps* if rough is rendered within 0.4 s of it. It is an *edge*, as the paper's
operator took it, if rough began no earlier than 0.1 s before the finger was over the
edge and ends with the touch or within 0.4 s: place and time then say what it was.

*pressure*: share of the time in contact that is *non-valid*, by pressing force: under
the gate, or rated none by the model.

*irregularities*: strokes over glass with one scratch or one grain. A *hit* is rough, or
more than twice the roughness of plain glass at its 99th percentile, while the finger
passes and for 0.4 s more; its *place* is where the finger was.

*regularity*: rank correlation of the sound's median frequency over speed with how many
ridges, or grains, a metre has.
"""

import argparse
from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy import signal, stats

from tactophone import AudioBlock, Prediction, Touch, open_pipeline
from tactophone.core.types import LIVE_SAMPLE_RATE as RATE
from tactophone.core.types import FloatArray
from tactophone_lab.simulation import surface
from tactophone_lab.simulation.catalogue import SimulatedObject, find
from tactophone_lab.simulation.microphone_models import COMPETITION, SessionVariation
from tactophone_lab.simulation.motion import DEPTH, row, single
from tactophone_lab.simulation.source import SimulatedFinger, Truth
from tactophone_lab.simulation.strokes import Script, Visit, explore, log_uniform
from tactophone_lab.simulation.surface import Grains, Ridges

SHIPPED = ("texture", "paper", "paper-mono")
STROKES = 8
"""Over each kind of mark at each speed."""

LANDING = 0.3
"""Seconds after landing, which sounds rough by itself, that say nothing of the
glass."""

AFTER = 0.4
"""Seconds: a window of 256 ms and the fall."""


def heard(sound: FloatArray, model: str) -> list[Prediction]:
    """Predict as a live operator would: the contact threshold follows the sound."""
    pipeline = open_pipeline(model, sample_rate=RATE, channels=2)
    step = pipeline.push(AudioBlock(sound, RATE, 0))
    return [*step.predictions]


def slip(seed: int) -> tuple[FloatArray, Truth, float]:
    """Return the sound of one visit that ends over the edge, its truth, and when the
    finger left the stone, in s."""
    rng = np.random.default_rng([0x511, seed])
    scene = row([find("smooth competition stone")])
    placed = scene.placed[0]
    script = Script(rng, x=placed.centre[0], y=placed.centre[1])
    explore(
        script,
        placed,
        Visit(
            1.5,
            log_uniform(rng, (0.5, 2.5)),
            log_uniform(rng, (0.04, 0.14)),
            slips=True,
        ),
    )
    script.hover(0.7)
    session = SessionVariation.draw(7000 + seed, COMPETITION)
    finger = SimulatedFinger(
        scene, script.moves, session=session, seed=[0x511, seed], place=placed.centre
    )
    sound = finger.render(round(script.time * RATE)).samples
    left = np.flatnonzero(finger.truth.object_index == 1)
    return sound, finger.truth, left[0] / RATE if left.size else float("nan")


def slips(models: Sequence[str]) -> None:
    made = [slip(seed) for seed in range(120)]
    made = [each for each in made if np.isfinite(each[2])][:100]
    print("| model | slips | bumps | of them taken for an edge |\n|---|--:|--:|--:|")
    for model in models or SHIPPED:
        bumps = edges = 0
        for sound, _, when in made:
            rough = np.array(
                [each.end for each in heard(sound, model) if each.touch is Touch.ROUGH]
            )
            near = rough[(rough > when) & (rough < when + AFTER)]
            if near.size:
                bumps += 1
                late = rough[rough > when - 0.1]
                edges += bool(
                    not np.any((rough > when - 0.5) & (rough < when - 0.1))
                    and late[-1] < when + 2 * AFTER
                )
        print(f"| {model} | {len(made)} | {bumps} | {edges} |", flush=True)


def strokes(
    obj: SimulatedObject, force: float, speed: float, *, seed: int, count: int = 4
) -> tuple[FloatArray, Truth]:
    """Stroke an object to and fro along its middle with one force and one peak
    speed."""
    rng = np.random.default_rng([0x57, seed])
    scene = single(obj)
    placed = scene.placed[0]
    left, right = placed.left + 0.01, placed.left + placed.width - 0.01
    script = Script(rng, x=left, y=placed.centre[1])
    script.hover(1.0)
    for turn in range(count):
        script.land(force)
        script.stroke(
            left if turn % 2 else right, 15 / 8 * (right - left) / speed, force
        )
        script.hover(0.6)
    finger = SimulatedFinger(
        scene,
        script.moves,
        session=SessionVariation.draw(9000 + seed),
        seed=[0x57, seed],
        place=(left, 0.5 * DEPTH),
    )
    return finger.render(round(script.time * RATE)).samples, finger.truth


def at(values: np.ndarray, seconds: np.ndarray) -> np.ndarray:
    return values[np.clip((seconds * RATE).astype(int), 0, len(values) - 1)]


def pressure(models: Sequence[str]) -> None:
    objects = [find(str(number)) for number in (0, 3, 5, 9, 21, 23, 26, 29)]
    print("Share of the time in contact that is non-valid, by pressing force.\n")
    print(
        "| model | "
        + " | ".join(f"{force:g} N" for force in (0.25, 0.5, 1, 2, 4))
        + " |\n|---|--:|--:|--:|--:|--:|"
    )
    for model in models or SHIPPED:
        shares = []
        for force in (0.25, 0.5, 1.0, 2.0, 4.0):
            invalid = touched = 0
            for seed, obj in enumerate(objects):
                sound, truth = strokes(obj, force, 0.1, seed=seed)
                found = heard(sound, model)
                ends = np.array([each.end for each in found])
                inside = at(truth.touch, ends) != Touch.NONE
                touched += int(inside.sum())
                likeliest = np.array([each.probabilities for each in found]).argmax(
                    axis=1
                )
                invalid += int((inside & (likeliest == Touch.NONE)).sum())
            shares.append(invalid / touched)
        print(
            f"| {model} | " + " | ".join(f"{share:.2f}" for share in shares) + " |",
            flush=True,
        )


MARKS = {"scratch": (-25e-6, 0.1e-3), "grain": (60e-6, 0.15e-3)}
"""Height and half-width in m."""

_unmarked = surface.height_profile


def _with_mark(wanted: surface.Surface) -> surface.Profile:
    """Draw a surface; one named ``scratch`` or ``grain`` and a place in mm has that
    there."""
    height, (kind, _, place) = _unmarked(wanted), wanted.name.partition(" ")
    if kind in MARKS:
        depth, radius = MARKS[kind]
        offset = (
            surface.HEIGHT_SPACING * np.arange(len(height)) - 1e-3 * float(place)
        ) / radius
        height += depth * np.sqrt(np.clip(1 - offset**2, 0, None))
    return height


surface.height_profile = _with_mark


def marked(kind: str, seed: int) -> tuple[SimulatedObject, float]:
    """Return glass with one scratch or grain on the way of the stroke, and its place
    along it in m."""
    glass = find("window")
    place = float(np.random.default_rng([0x3A, seed]).uniform(25, 55))
    return replace(
        glass,
        surface=replace(glass.surface, name=f"{kind} {place}", seed=seed),
        length=0.1,
    ), 1e-3 * place


def irregularities(models: Sequence[str]) -> None:
    print(
        "| model | mark | speed (cm/s) | hits | of | false on plain glass | place "
        "after the mark, p50 (mm) |"
    )
    print("|---|---|--:|--:|--:|--:|--:|")
    for model in models or SHIPPED:
        for kind in ("scratch", "grain"):
            for speed in (0.05, 0.10, 0.15):
                places, false = list[float](), 0
                for seed in range(STROKES):
                    obj, place = marked(kind, seed)
                    plain = replace(obj, surface=replace(obj.surface, name="plain"))
                    base = passes(plain, place, speed, model, seed, least=None)
                    quiet = np.array([value for _, value, _ in base])
                    least = 2 * float(np.percentile(quiet, 99)) if quiet.size else 0.5
                    found = [
                        x
                        for near, _, x in passes(obj, place, speed, model, seed, least)
                        if near
                    ]
                    false += any(
                        near
                        for near, _, _ in passes(
                            plain, place, speed, model, seed + 500, least
                        )
                    )
                    places += [1e3 * (x - place) for x in found[:1]]
                middle = f"{np.median(places):.0f}" if places else "-"
                print(
                    f"| {model} | {kind} | {100 * speed:.0f} | {len(places)} | "
                    f"{STROKES} | {false} | {middle} |",
                    flush=True,
                )


def passes(
    obj: SimulatedObject,
    place: float,
    speed: float,
    model: str,
    seed: int,
    least: float | None,
) -> list[tuple[bool, float, float]]:
    """Return for each prediction in touch whether it is a hit near the mark, its
    roughness, and the finger's place."""
    sound, truth = strokes(obj, 1.0, speed, seed=seed, count=1)
    begun = np.flatnonzero(truth.touch != Touch.NONE)[0]
    along = truth.x - truth.x[begun]
    crossed = np.flatnonzero((truth.touch != Touch.NONE) & (along >= place))
    when = crossed[0] / RATE if crossed.size else np.inf
    found = []
    for each in heard(sound, model):
        if each.touch is not Touch.NONE and each.end > begun / RATE + LANDING:
            strong = each.touch is Touch.ROUGH or (
                least is not None and each.roughness > least
            )
            near = strong and when <= each.end <= when + AFTER
            found.append(
                (near, each.roughness, float(at(along, np.array([each.end]))[0]))
            )
    return found


def regularity(_: Sequence[str]) -> None:
    periods = np.geomspace(0.3e-3, 2.5e-3, 8)
    stone = find("smooth competition stone")
    print(
        "| texture | surfaces | rank correlation with ridges or grains a metre "
        "|\n|---|--:|--:|"
    )
    for name, features in (
        (
            "regular: ridges",
            [{"ridges": Ridges(period, period / 20)} for period in periods],
        ),
        (
            "irregular: grains",
            [{"grains": Grains(period, period / 10, 0.6, 0.9)} for period in periods],
        ),
    ):
        ratio, density = [], []
        for seed, (period, feature) in enumerate(zip(periods, features, strict=True)):
            obj = replace(stone, surface=replace(stone.surface, pits=None, **feature))
            for speed in (0.05, 0.1, 0.15):
                sound, truth = strokes(obj, 1.0, speed, seed=seed, count=2)
                moving = truth.touch != Touch.NONE
                frequency, power = signal.welch(sound[moving, 0], RATE, nperseg=4096)
                band = (frequency > 30) & (frequency < 8000)
                total = np.cumsum(power[band])
                ratio.append(
                    frequency[band][np.searchsorted(total, total[-1] / 2)] / speed
                )
                density.append(1 / period)
        print(
            f"| {name} | {len(periods)} | "
            f"{stats.spearmanr(ratio, density).statistic:.2f} |",
            flush=True,
        )


ROWS = {
    "slips": slips,
    "pressure": pressure,
    "irregularities": irregularities,
    "regularity": regularity,
}


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("row", choices=ROWS)
    parser.add_argument(
        "models", nargs="*", help="names or files; the shipped ones by default"
    )
    args = parser.parse_args()
    ROWS[args.row](args.models)


if __name__ == "__main__":
    main()
