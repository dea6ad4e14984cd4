"""The competition's task as recordings: five stones in a curtained box, three smooth,
two rough, on two days."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from tactophone.core.recordings.values import Recording
from tactophone.core.tips import DEFAULT_TIP
from tactophone.core.types import LIVE_SAMPLE_RATE, SURFACE_LABELS, FloatArray, Touch
from tactophone_lab.simulation.microphone_models import SessionVariation
from tactophone_lab.simulation.motion import Scene, five_stones
from tactophone_lab.simulation.recording_levels import FIRST, electronics
from tactophone_lab.simulation.render import (
    RenderMetadata,
    read_render_metadata,
    through_opus,
    touch_segments,
    write_sound,
)
from tactophone_lab.simulation.source import SimulatedFinger, Truth
from tactophone_lab.simulation.strokes import Script, Visit, explore, log_uniform
from tactophone_lab.simulation.takes import shuffled

COMPETITION_VERSION = "2"
"""Raise it when the same seed gives other sound."""

DAYS = (1, 2)

SAMPLE_DAY = 0
"""A day before the competition, with a set-up of its own: samples of the stones, on
which the paper's fine-tuned model has trained."""
"""Numbers of the competition's days."""

_START = (-0.05, 0.035)
"""Where the finger starts in m, x and y: left of the first stone."""


@dataclass(frozen=True, slots=True)
class Task:
    """How the stones are explored, and with which set-up.

    Parameters
    ----------
    force, speed, visit
        Ranges of newtons, of peak m/s and of seconds that a visit is drawn from.
    slips
        Share of stones that the finger leaves over the edge; the paper saw one false
        positive from this (section V-B).
    levels
        Gains and noise, one of `~tactophone_lab.simulation.recording_levels.LEVELS`.
    knob_db, hum_db
        Both preamplifiers are set anew each day, within this many dB either way; and
        the hum of another building is within this many dB.
    """

    force: tuple[float, float] = (0.5, 2.5)
    speed: tuple[float, float] = (0.04, 0.14)
    visit: tuple[float, float] = (2.0, 4.0)
    slips: float = 0.35
    levels: str = FIRST
    knob_db: float = 0.0
    hum_db: float = 0.0

    def session(self, seed: int, tip: str) -> SessionVariation:
        """Return a day's set-up."""
        wired = electronics(self.levels, hall=True, tip=tip)
        drawn = SessionVariation.draw(seed, wired, tip=tip)
        rng = np.random.default_rng([0xDA1, seed])
        contact_db, air_db = rng.uniform(-self.knob_db, self.knob_db, 2)
        set_anew = drawn.electronics.amplified(contact_db, air_db)
        hum_dbfs = set_anew.contact_hum_dbfs + rng.uniform(-self.hum_db, self.hum_db)
        return replace(drawn, electronics=set_anew._replace(contact_hum_dbfs=hum_dbfs))


TASKS = {
    "box": Task(),
    "finals": Task(
        force=(0.2, 1.5),
        speed=(0.02, 0.08),
        visit=(1.0, 3.0),
        slips=0.15,
        levels="derived",
        knob_db=3.0,
        hum_db=3.0,
    ),
}
"""By the word of ``tactophone simulate competition --task``. What sets `finals` apart
is derived in docs/research/recording-levels.md, written before it was scored."""


@dataclass(frozen=True, slots=True)
class CompetitionRun:
    """One exploration of all five stones, left to right; each day has its set-up, each
    run its order of stones."""

    day: int
    number: int
    seed: int = 0
    tip: str = DEFAULT_TIP
    task: Task = TASKS["box"]
    opus: bool = False
    """Whether the sound passes through Opus, as the operator's side gets it."""

    @property
    def name(self) -> str:
        return f"day_{self.day}_run_{self.number}"

    @property
    def fingerprint(self) -> str:
        """Everything that the sound depends on."""
        return (
            f"competition {COMPETITION_VERSION} {self.seed} {self.name} {self.tip} "
            f"{self.task} {self.opus}"
        )

    @property
    def scene(self) -> Scene:
        return five_stones(self.order)

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
            rng.uniform(*run.task.visit),
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
    samples = finger.render(round(script.time * LIVE_SAMPLE_RATE)).samples
    return through_opus(samples) if run.opus else samples, finger.truth


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
        "ra_um": " ".join(
            f"{placed.object.roughness.ra * 1e6:.2f}" for placed in run.scene.placed
        ),
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
    ``..._rough.wav``; and samples of the stones, ``sample_smooth.wav`` and so on."""
    written = []
    runs = [replace(runs[0], day=SAMPLE_DAY, number=1), *runs]
    for day in sorted({run.day for run in runs}):
        rendered = [render_run(run) for run in runs if run.day == day]
        for label in SURFACE_LABELS:
            sound = np.concatenate(
                [samples[truth.touch == label] for samples, truth in rendered]
            )
            name = "sample" if day == SAMPLE_DAY else f"day_{day}"
            path = folder / "finals_recordings" / f"{name}_{label.name.lower()}.wav"
            write_sound(
                path,
                sound,
                RenderMetadata(f"finals {runs[0].fingerprint}", ()),
                bits=bits,
            )
            written.append(path)
    return written
