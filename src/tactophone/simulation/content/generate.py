"""The full data set: every object, mounting and take, rendered by several processes, resumable after a kill."""

import hashlib
from collections.abc import Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from dataclasses import dataclass
from multiprocessing import get_context
from pathlib import Path
from types import MappingProxyType

import numpy as np

from tactophone.dataset import Recording, write_metadata
from tactophone.simulation.content.catalogue import SCENARIOS, TEST, TestObject
from tactophone.simulation.content.movement import TAKES, Take, take_moves
from tactophone.simulation.content.render_store import RenderMetadata, read_metadata_of, tell, through_opus, write_sound
from tactophone.simulation.physics.finger import FLEXURE
from tactophone.simulation.physics.modes import Mounting
from tactophone.simulation.physics.motion import Hand, Move
from tactophone.simulation.physics.scene import Scene, single
from tactophone.simulation.physics.session_variation import SessionVariation
from tactophone.simulation.physics.source import RATE, SimulatedFinger, Truth
from tactophone.types import FloatArray, Touch

VERSION = "1"
"""Of the simulation; raise it when the same seed sounds different, and old files are made anew."""

DURATION = 30.0
"""Seconds of a take, as in the paper."""

SLIDING = 0.005
"""Metres a second from which a finger slides; free exploration has 2 to 20 cm/s (simulation.movement)."""


@dataclass(frozen=True, slots=True)
class Style:
    """How files are made and named.

    Parameters
    ----------
    duration
        Seconds a take.
    seed
        Another seed gives other sessions, strokes and noise.
    opus
        Pass the sound through Opus and back.
    authors_layout
        ``opus/stereo/NN_variant.wav`` in place of ``OBJECT/MOUNTING/TAKE.flac``.
    bits
        16 or 24 a sample.
    """

    duration: float = DURATION
    seed: int = 0
    opus: bool = False
    authors_layout: bool = False
    bits: int = 16


@dataclass(frozen=True, slots=True)
class Job:
    """One recording to make: an object, mounted somehow, and a take of it."""

    thing: TestObject
    mounting: Mounting
    take: Take
    style: Style

    @property
    def name(self) -> str:
        """The file's path from the data set's folder."""
        if self.style.authors_layout:
            return f"opus/stereo/{self.thing.number:02}_{self.take.name}.wav"
        folder = f"{self.thing.number:02}-{self.thing.name.replace(', ', '-').replace(' ', '-').lower()}"
        return f"{folder}/{self.mounting}/{self.take.name}.flac"

    @property
    def recipe(self) -> str:
        """A hash of everything that the sound depends on."""
        return hashlib.sha256(f"{VERSION} {self!r} {SessionVariation()!r} {FLEXURE!r}".encode()).hexdigest()[:16]

    @property
    def session(self) -> int:
        """The number that draws the set-up: the seven takes of an object in a mounting share one."""
        return int(np.random.SeedSequence([self.style.seed, self.thing.number, list(Mounting).index(self.mounting)])
                   .generate_state(1)[0])  # fmt: skip


def plan(
    things: Sequence[TestObject], style: Style, *, scenarios: bool = False, takes: Sequence[Take] = TAKES
) -> tuple[Job, ...]:
    """List the recordings: each object as the catalogue mounts it, or, if it can be moved, in all three scenarios."""
    return tuple(
        Job(thing, mounting, take, style)
        for thing in things
        for mounting in (SCENARIOS if scenarios and thing.movable else (thing.mounting,))
        for take in takes
    )


def make(folder: Path, jobs: Sequence[Job], *, processes: int = 1) -> Iterator[Job]:
    """Make the recordings that are not there yet; gives each job as it is done, those already done first.

    Call :func:`finish` afterwards, even after an interruption, to write the manifest of what there is.
    """
    todo = []
    for job in jobs:
        if is_done(folder, job):
            yield job
        else:
            todo.append(job)
    if processes == 1 or len(todo) < 2:
        yield from (_make(folder, job) for job in todo)
        return
    # The first one compiles the kernels; started together, every process would compile them for itself.
    yield _make(folder, todo.pop(0))
    with ProcessPoolExecutor(processes, mp_context=get_context("spawn")) as pool:
        try:
            for future in as_completed([pool.submit(_make, folder, job) for job in todo]):
                yield future.result()
        finally:
            pool.shutdown(cancel_futures=True)


def finish(folder: Path, jobs: Sequence[Job]) -> int:
    """Write ``metadata.csv`` for the jobs that are done; gives their number. The authors' layout has no manifest."""
    told = [
        (job, story) for job in jobs if (story := read_metadata_of(folder / job.name)) and story.recipe == job.recipe
    ]
    recordings = [recording(folder, job, story) for job, story in told]
    if recordings and not jobs[0].style.authors_layout:
        write_metadata(folder, recordings)
    return len(recordings)


def is_done(folder: Path, job: Job) -> bool:
    """Tell whether a recording is there, made just so."""
    story = read_metadata_of(folder / job.name)
    return story is not None and story.recipe == job.recipe


def render(job: Job) -> tuple[FloatArray, Truth]:
    """Render one recording: both microphones, and the truth."""
    scene = single(job.thing, job.mounting)
    moves = _moves(job, scene)
    noise = [job.style.seed, job.session, TAKES.index(job.take)]
    finger = SimulatedFinger(
        scene, moves, setup=SessionVariation.draw(job.session), seed=noise, place=scene.placed[0].centre
    )
    block = finger.render(round(job.style.duration * finger.sample_rate))
    return (through_opus(block.samples) if job.style.opus else block.samples), finger.truth


def slides(job: Job, story: RenderMetadata) -> str:
    """Tell when the finger slides on what it touches: stretches of ``start-end`` in seconds, divided by spaces."""
    scene = single(job.thing, job.mounting)
    place = scene.placed[0].centre
    hand = Hand(scene.field, x=place[0], y=place[1], rate=RATE)
    hand.wish(_moves(job, scene))
    speed = np.abs(hand.follow(round(job.style.duration * RATE)).motion.speed)
    time = np.arange(len(speed)) / RATE
    touching = [(time >= one.start) & (time < one.end) for one in story.segments if one.contact]
    sliding = (speed > SLIDING) & np.any([np.zeros(len(time), bool), *touching], axis=0)
    bounds = np.flatnonzero(np.diff(np.concatenate(([0], sliding.astype(np.int8), [0])))) / RATE
    return " ".join(f"{start:.3f}-{end:.3f}" for start, end in bounds.reshape(-1, 2))


def recording(folder: Path, job: Job, story: RenderMetadata) -> Recording:
    """What the manifest says of a recording."""
    rough = job.thing.roughness
    properties = {
        "object": job.thing.name,
        "material": job.thing.substance,
        "stroke": job.take.stroke,
        "pressure": job.take.pressure,
        "split": "test" if job.thing.number in TEST else "train",
        "ra_um": f"{rough.ra * 1e6:.2f}",
        "rq_um": f"{rough.rq * 1e6:.2f}",
        "slides": slides(job, story),
        "seed": str(job.style.seed),
        "source": "simulated",
    }
    return Recording(
        folder / job.name,
        job.thing.surface.name,
        Touch(job.thing.label),
        ("contact", "air"),
        take=job.take.name,
        scenario=str(job.mounting),
        session=f"{job.session:08x}",
        segments=story.segments,
        properties=MappingProxyType(properties),
    )


def _moves(job: Job, scene: Scene) -> list[Move]:
    seed = np.random.SeedSequence([job.style.seed, job.session, TAKES.index(job.take)])
    rng = np.random.default_rng(seed.spawn(1)[0])
    return take_moves(job.take, scene.placed[0], duration=job.style.duration, rng=rng)


def _make(folder: Path, job: Job) -> Job:
    samples, truth = render(job)
    segments, things = tell(truth.thing, single(job.thing, job.mounting))
    write_sound(folder / job.name, samples, RenderMetadata(job.recipe, segments, things), bits=job.style.bits)
    return job
