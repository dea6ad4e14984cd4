"""The competition's task as recordings: five stones in a curtained box, three smooth,
two rough, on two days."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from tactophone.core.recordings.values import Recording
from tactophone.core.tips import DEFAULT_TIP
from tactophone.core.types import LIVE_SAMPLE_RATE, SURFACE_LABELS, FloatArray, Touch
from tactophone_lab.simulation.microphone_models import COMPETITION, SessionVariation
from tactophone_lab.simulation.motion import Scene, five_stones
from tactophone_lab.simulation.render import (
    RenderMetadata,
    read_render_metadata,
    touch_segments,
    write_sound,
)
from tactophone_lab.simulation.source import SimulatedFinger, Truth
from tactophone_lab.simulation.strokes import Script, Visit, explore, log_uniform
from tactophone_lab.simulation.takes import shuffled

COMPETITION_VERSION = "2"
"""Raise it when the same seed gives other sound."""

DAYS = (1, 2)

_START = (-0.05, 0.035)


@dataclass(frozen=True, slots=True)
class Task:
    """How hard the stones are to tell apart.

    Parameters
    ----------
    force, speed
        Ranges of newtons and of peak m/s that a visit is drawn from.
    slips
        Share of stones that the finger leaves over the edge; the paper saw one false
        positive from this (section V-B).
    paint
        Share of the smooth stones' geometry in the rough ones', 0 to 1, where both
        kinds are alike.
    damping
        Factor of the pad's loss, along and across, as of a glove over it; what the tip
        radiates falls by as much.
    """

    force: tuple[float, float] = (0.5, 2.5)
    speed: tuple[float, float] = (0.04, 0.14)
    slips: float = 0.35
    paint: float = 0.0
    damping: float = 1.0

    def session(self, seed: int, tip: str) -> SessionVariation:
        drawn = SessionVariation.draw(seed, COMPETITION, tip=tip)
        finger, factor = drawn.finger, self.damping
        return replace(
            drawn,
            finger=finger._replace(
                pad_damping=finger.pad_damping * factor,
                shear_damping=finger.shear_damping * factor,
                pad_radiation=finger.pad_radiation / factor,
                shear_radiation=finger.shear_radiation / factor,
            ),
        )


TASKS = {
    "box": Task(),
    "hard": Task(
        force=(0.2, 0.9), speed=(0.03, 0.1), slips=0.6, paint=0.92, damping=2.0
    ),
}
"""By the word of ``tactophone simulate competition --task``."""


@dataclass(frozen=True, slots=True)
class CompetitionRun:
    """One exploration of all five stones, left to right; each day has its set-up, each
    run its order of stones."""

    day: int
    number: int
    seed: int = 0
    tip: str = DEFAULT_TIP
    task: Task = TASKS["box"]

    @property
    def name(self) -> str:
        return f"day_{self.day}_run_{self.number}"

    @property
    def fingerprint(self) -> str:
        """Everything that the sound depends on."""
        return (
            f"competition {COMPETITION_VERSION} {self.seed} {self.name} {self.tip} "
            f"{self.task}"
        )

    @property
    def scene(self) -> Scene:
        return five_stones(self.order, paint=self.task.paint)

    @property
    def order(self) -> tuple[Touch, ...]:
        """Smooth and rough, left to right."""
        return shuffled(
            int(
                np.random.SeedSequence(
                    [self.seed, self.day, self.number]
                ).generate_state(1)[0]
            )
        )


def render_run(run: CompetitionRun) -> tuple[FloatArray, Truth]:
    """Render a run of about half a minute: sound ``(samples, 2)`` with motors and hall,
    and the ground truth."""
    rng = np.random.default_rng([0xC0, run.seed, run.day, run.number])
    script = Script(rng, x=_START[0], y=_START[1])
    script.hover(rng.uniform(1, 2.5))
    scene = run.scene
    for placed in scene.placed:
        visit = Visit(
            rng.uniform(2, 4),
            log_uniform(rng, run.task.force),
            log_uniform(rng, run.task.speed),
            slips=rng.random() < run.task.slips,
        )
        explore(script, placed, visit)
    script.hover(1.0)
    session = run.task.session(1000 * run.seed + run.day, run.tip)
    seed = [0xC1, run.seed, run.day, run.number]
    finger = SimulatedFinger(
        scene, script.moves, session=session, seed=seed, place=_START
    )
    return finger.render(round(script.time * LIVE_SAMPLE_RATE)).samples, finger.truth


def write_run(folder: Path, run: CompetitionRun, *, bits: int = 16) -> None:
    """Write a run's sound, unless it is there."""
    path = folder / f"{run.name}.flac"
    metadata = read_render_metadata(path)
    if metadata is None or metadata.fingerprint != run.fingerprint:
        samples, truth = render_run(run)
        segments = touch_segments(truth.object_index, run.scene)
        write_sound(path, samples, RenderMetadata(run.fingerprint, segments), bits=bits)


def run_recording(folder: Path, run: CompetitionRun) -> Recording:
    """Return the manifest's entry of a run that has been written."""
    metadata = read_render_metadata(folder / f"{run.name}.flac")
    properties = {
        "stones": " ".join(label.name.lower() for label in run.order),
        "split": "competition",
        "tip": run.tip,
        "source": "simulated",
    }
    return Recording(
        folder / f"{run.name}.flac",
        "competition stones",
        None,
        ("contact", "air"),
        take=f"run_{run.number}",
        scenario="competition",
        session=f"day {run.day}",
        segments=metadata.segments if metadata else (),
        properties=properties,
    )


def write_finals(
    folder: Path, runs: Sequence[CompetitionRun], *, bits: int = 16
) -> list[Path]:
    """Write a day's runs as the authors did: ``finals_recordings/day_D_smooth.wav`` and
    ``..._rough.wav``."""
    written = []
    for day in sorted({run.day for run in runs}):
        rendered = [render_run(run) for run in runs if run.day == day]
        for label in SURFACE_LABELS:
            sound = np.concatenate(
                [samples[truth.touch == label] for samples, truth in rendered]
            )
            path = folder / "finals_recordings" / f"day_{day}_{label.name.lower()}.wav"
            write_sound(
                path,
                sound,
                RenderMetadata(f"finals {runs[0].fingerprint}", ()),
                bits=bits,
            )
            written.append(path)
    return written
