"""The paper's data set: every object, mounting and take, rendered by several processes; resumes after a kill."""

import hashlib
from collections.abc import Iterator, Sequence
from concurrent.futures import as_completed
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from tactophone.dataset import Recording, write_metadata
from tactophone.dataset.values import MotionInterval, write_slides
from tactophone.processes import open_pool
from tactophone.simulation.content.catalogue import SCENARIOS, TEST, SimulatedObject
from tactophone.simulation.content.movement import take_moves
from tactophone.simulation.content.render_store import (
    RenderMetadata,
    read_render_metadata,
    through_opus,
    touch_segments,
    write_sound,
)
from tactophone.simulation.content.takes import TAKES, Take
from tactophone.simulation.physics.modes import Mounting
from tactophone.simulation.physics.motion import Hand, Move
from tactophone.simulation.physics.scene import Scene, single
from tactophone.simulation.physics.session_variation import COMPETITION, SessionVariation
from tactophone.simulation.physics.source import SimulatedFinger, Truth
from tactophone.simulation.physics.tip import tip_named
from tactophone.types import DEFAULT_TIP, LIVE_SAMPLE_RATE, FloatArray, Touch

VERSION = "3"
"""Version of the simulation. Raise it when the same seed gives other sound: existing files are then rendered again."""

DURATION = 30.0
"""Seconds of a take, as in the paper."""

SLIDING = 0.005
"""Speed in m/s from which a finger slides; free exploration has 2 to 20 cm/s (simulation.movement)."""


@dataclass(frozen=True, slots=True)
class RenderOptions:
    """How recordings are rendered and named."""

    duration: float = DURATION
    """Seconds of a take."""
    seed: int = 0
    """Of sessions, strokes and noise."""
    opus: bool = False
    """Whether the sound passes through Opus."""
    hall: bool = False
    """Whether the room is the competition's: a hall full of people, and running motors."""
    authors_layout: bool = False
    """``opus/stereo/NN_variant.wav`` in place of ``OBJECT/MOUNTING/TAKE.flac``."""
    bits: int = 16
    """16 or 24 per sample."""
    tip: str = DEFAULT_TIP
    """What touches: one of `~tactophone.simulation.physics.tip.TIPS`."""


@dataclass(frozen=True, slots=True)
class RenderJob:
    """One recording: an object in a mounting, and a take of it."""

    object: SimulatedObject
    mounting: Mounting
    take: Take
    options: RenderOptions

    @property
    def name(self) -> str:
        """Path of the file, relative to the data set's folder."""
        if self.options.authors_layout:
            return f"opus/stereo/{self.object.number:02}_{self.take.name}.wav"
        folder = f"{self.object.number:02}-{self.object.name.replace(', ', '-').replace(' ', '-').lower()}"
        return f"{folder}/{self.mounting}/{self.take.name}.flac"

    @property
    def fingerprint(self) -> str:
        """A hash of everything that the sound depends on."""
        tip = tip_named(self.options.tip)
        return hashlib.sha256(f"{VERSION} {self!r} {SessionVariation()!r} {tip!r}".encode()).hexdigest()[:16]

    @property
    def session(self) -> int:
        """Seed of the set-up, which the seven takes of an object in a mounting share."""
        mounting = list(Mounting).index(self.mounting)
        return int(np.random.SeedSequence([self.options.seed, self.object.number, mounting]).generate_state(1)[0])


def plan_dataset(
    objects: Sequence[SimulatedObject],
    options: RenderOptions,
    *,
    scenarios: bool = False,
    takes: Sequence[Take] = TAKES,
) -> tuple[RenderJob, ...]:
    """List the recordings: each object as the catalogue mounts it, movable ones with ``scenarios`` in all three."""
    return tuple(
        RenderJob(obj, mounting, take, options)
        for obj in objects
        for mounting in (SCENARIOS if scenarios and obj.movable else (obj.mounting,))
        for take in takes
    )


def render_dataset(folder: Path, jobs: Sequence[RenderJob], *, processes: int = 1) -> Iterator[RenderJob]:
    """Render the missing recordings; yields each job when it is done, existing ones first.

    Call :func:`write_manifest` afterwards, also after an interruption.
    """
    missing = []
    for job in jobs:
        if _metadata(folder, job):
            yield job
        else:
            missing.append(job)
    if processes == 1 or len(missing) < 2:
        yield from (_write(folder, job) for job in missing)
        return
    # The first job compiles the kernels; started at once, every process would compile them again.
    yield _write(folder, missing.pop(0))
    with open_pool(processes) as pool:
        try:
            for future in as_completed([pool.submit(_write, folder, job) for job in missing]):
                yield future.result()
        finally:
            pool.shutdown(cancel_futures=True)


def write_manifest(folder: Path, jobs: Sequence[RenderJob]) -> int:
    """Write ``metadata.csv`` for the finished jobs; return their number. The authors' layout has no manifest."""
    recordings = [_recording(folder, job, metadata) for job in jobs if (metadata := _metadata(folder, job))]
    if recordings and not jobs[0].options.authors_layout:
        write_metadata(folder, recordings)
    return len(recordings)


def render(job: RenderJob) -> tuple[FloatArray, Truth]:
    """Render one recording: the sound, shape ``(samples, 2)`` at 48 kHz, and the ground truth."""
    scene = single(job.object, job.mounting)
    noise = [job.options.seed, job.session, TAKES.index(job.take)]
    electronics = COMPETITION if job.options.hall else None
    session = SessionVariation.draw(job.session, electronics, tip=job.options.tip)
    finger = SimulatedFinger(scene, _moves(job, scene), session=session, seed=noise, place=scene.placed[0].centre)
    block = finger.render(round(job.options.duration * LIVE_SAMPLE_RATE))
    return (through_opus(block.samples) if job.options.opus else block.samples), finger.truth


def _metadata(folder: Path, job: RenderJob) -> RenderMetadata | None:
    """Metadata of the job's file, or ``None`` if the file is missing or was rendered otherwise."""
    metadata = read_render_metadata(folder / job.name)
    return metadata if metadata and metadata.fingerprint == job.fingerprint else None


def _slides(job: RenderJob, metadata: RenderMetadata) -> tuple[MotionInterval, ...]:
    """Intervals in which the finger touches something and moves faster than `SLIDING`."""
    scene = single(job.object, job.mounting)
    x, y = scene.placed[0].centre
    hand = Hand(scene.field, x=x, y=y, rate=LIVE_SAMPLE_RATE)
    hand.queue(_moves(job, scene))
    speed = np.abs(hand.follow(round(job.options.duration * LIVE_SAMPLE_RATE)).motion.speed)
    time = np.arange(len(speed)) / LIVE_SAMPLE_RATE
    touching = [(time >= segment.start) & (time < segment.end) for segment in metadata.segments if segment.contact]
    sliding = (speed > SLIDING) & np.any([np.zeros(len(time), bool), *touching], axis=0)
    # A difference of +1 is where a slide starts, one of -1 where it ends: starts and ends alternate.
    bounds = np.flatnonzero(np.diff(np.concatenate(([0], sliding.astype(np.int8), [0])))) / LIVE_SAMPLE_RATE
    return tuple(MotionInterval(*map(float, pair)) for pair in bounds.reshape(-1, 2))


def _recording(folder: Path, job: RenderJob, metadata: RenderMetadata) -> Recording:
    roughness = job.object.roughness
    properties = {
        "object": job.object.name,
        "material": job.object.substance,
        # Casts of one stuff, with and without sand, are kin.
        "kin": job.object.substance.partition(" with ")[0],
        "stroke": job.take.stroke,
        "pressure": job.take.pressure,
        "split": "test" if job.object.number in TEST else "train",
        "ra_um": f"{roughness.ra * 1e6:.2f}",
        "rq_um": f"{roughness.rq * 1e6:.2f}",
        "slides": write_slides(_slides(job, metadata)),
        "seed": str(job.options.seed),
        "tip": job.options.tip,
        "source": "simulated",
    }
    return Recording(
        folder / job.name,
        job.object.surface.name,
        Touch(job.object.label) if job.object.label else None,  # measured surfaces have none
        ("contact", "air"),
        take=job.take.name,
        scenario=str(job.mounting),
        session=f"{job.session:08x}",
        segments=metadata.segments,
        properties=properties,
    )


def _moves(job: RenderJob, scene: Scene) -> list[Move]:
    seed = np.random.SeedSequence([job.options.seed, job.session, TAKES.index(job.take)])
    rng = np.random.default_rng(seed.spawn(1)[0])
    return take_moves(job.take, scene.placed[0], duration=job.options.duration, rng=rng)


def _write(folder: Path, job: RenderJob) -> RenderJob:
    samples, truth = render(job)
    touched = touch_segments(truth.object_index, single(job.object, job.mounting))
    write_sound(folder / job.name, samples, RenderMetadata(job.fingerprint, *touched), bits=job.options.bits)
    return job
