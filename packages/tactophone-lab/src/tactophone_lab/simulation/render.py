"""Simulated sound on disk, and the paper's data set of it: complete files or none, each
with its ground truth.

A file is written under a temporary name and renamed, so that a kill leaves no
half-written file. Its comment tag holds a fingerprint of its parameters and the touched
objects over time: finished files need no side file. Several processes render every
object, mounting and take; after a kill they resume.
"""

import hashlib
import json
import shutil
from collections.abc import Iterable, Iterator, Sequence
from concurrent.futures import as_completed
from dataclasses import dataclass, field, replace
from itertools import pairwise
from pathlib import Path

import numpy as np
import soundfile
from numpy.typing import NDArray

from tactophone.core.errors import DatasetError
from tactophone.core.processes import atomic_write, open_pool
from tactophone.core.recordings.metadata import add_to_metadata, read_to_rewrite
from tactophone.core.recordings.values import (
    Intervals,
    Recording,
    Segment,
    stretches,
    within,
    write_slides,
)
from tactophone.core.tips import DEFAULT_TIP
from tactophone.core.types import LIVE_SAMPLE_RATE, FloatArray, Touch
from tactophone.net.link.codec import Codec, encode_and_decode
from tactophone_lab.simulation.catalogue import SCENARIOS, TEST, SimulatedObject
from tactophone_lab.simulation.finger import tip_named
from tactophone_lab.simulation.microphone_models import SessionVariation
from tactophone_lab.simulation.modes import Mounting
from tactophone_lab.simulation.motion import Move, MoveFollower, Scene, single
from tactophone_lab.simulation.recording_levels import FIRST, LEVELS, electronics
from tactophone_lab.simulation.room_sound import RoomSound
from tactophone_lab.simulation.source import SimulatedFinger, Truth
from tactophone_lab.simulation.strokes import take_moves
from tactophone_lab.simulation.takes import TAKES, Take

SHORTEST_RENDER = 0.03
"""Seconds; a shorter segment is merged into the one before it: the finger has bounced,
not moved on."""


@dataclass(frozen=True, slots=True)
class RenderMetadata:
    """A file's parameters as a ``fingerprint``, and what is touched when."""

    fingerprint: str
    segments: tuple[Segment, ...]


def write_sound(
    path: Path, samples: FloatArray, metadata: RenderMetadata, *, bits: int = 16
) -> None:
    """Write WAV or FLAC, by the path's suffix; the file appears complete or not at all.

    Raises `DatasetError` where there is a file that was not rendered.
    """
    if path.exists() and read_render_metadata(path) is None:
        raise DatasetError(
            f"{path}: is there already, and was not rendered: move it away, or name "
            "another folder"
        )
    segments = [
        [segment.start, segment.end, segment.label_name]
        for segment in metadata.segments
    ]
    with (
        atomic_write(path) as unfinished,
        soundfile.SoundFile(
            unfinished,
            "w",
            LIVE_SAMPLE_RATE,
            samples.shape[1],
            f"PCM_{bits}",
            format=path.suffix[1:].upper(),
        ) as file,
    ):
        file.comment = json.dumps(
            {"fingerprint": metadata.fingerprint, "segments": segments}
        )
        file.write(samples)


def read_render_metadata(path: Path) -> RenderMetadata | None:
    """Read a file's metadata; ``None`` if the file is missing or was not written by
    :func:`write_sound`."""
    try:
        with soundfile.SoundFile(path) as file:
            comment = json.loads(file.comment)
        return RenderMetadata(
            comment["fingerprint"],
            tuple(Segment(*each[:3]) for each in comment["segments"]),
        )
    except (OSError, soundfile.LibsndfileError, ValueError, KeyError, TypeError):
        return None


def touch_segments(
    object_index: NDArray[np.int16], scene: Scene
) -> tuple[Segment, ...]:
    """Turn the truth's ``object_index`` per sample into segments, one for each touch of
    an object.

    A segment is named by its object's label, the ground *contact*, the air *none*.
    """
    bounds = np.concatenate(
        [[0], np.flatnonzero(np.diff(object_index)) + 1, [len(object_index)]]
    )
    runs = _merged(
        (int(a), int(b), int(object_index[a])) for a, b in pairwise(bounds) if b > a
    )
    return tuple(
        Segment(
            round(a / LIVE_SAMPLE_RATE, 4),
            round(b / LIVE_SAMPLE_RATE, 4),
            _label_name(index, scene),
        )
        for a, b, index in runs
    )


def _merged(runs: Iterable[tuple[int, int, int]]) -> Iterable[tuple[int, int, int]]:
    """Merge each run of ``(start, end, object)`` that is too short, or of the same
    object, into the one before it."""
    last: tuple[int, int, int] | None = None
    for start, end, index in runs:
        if last and (
            index == last[2] or end - start < SHORTEST_RENDER * LIVE_SAMPLE_RATE
        ):
            last = (last[0], end, last[2])
            continue
        if last:
            yield last
        last = (start, end, index)
    if last:
        yield last


def _label_name(index: int, scene: Scene) -> str:
    if index < 0:
        return "none"
    label = scene.objects[index].label
    return "contact" if label is Touch.NONE else label.name.lower()


RENDER_VERSION = "3"
"""Version of the simulation. Raise it when the same seed gives other sound: existing
files are then rendered again."""

RENDER_DURATION = 30.0
"""Seconds of a take, as in the paper."""

SLIDING = 0.005
"""Speed in m/s from which a finger slides; free exploration has 2 to 20 cm/s
(simulation.strokes)."""


@dataclass(frozen=True, slots=True)
class RenderOptions:
    """How recordings are rendered and named."""

    duration: float = RENDER_DURATION
    """Seconds of a take."""
    seed: int = 0
    """Of sessions, strokes and noise."""
    opus: bool = False
    """Whether the sound passes through Opus."""
    hall: bool = False
    """Whether the room is the competition's: a hall full of people, and running
    motors."""
    authors_layout: bool = False
    """``opus/stereo/NN_variant.wav`` in place of ``OBJECT/MOUNTING/TAKE.flac``."""
    bits: int = 16
    """16 or 24 per sample."""
    tip: str = DEFAULT_TIP
    """What touches: one of `~tactophone_lab.simulation.finger.TIPS`."""
    gain_db: float = 0.0
    """Of the contact microphone's preamplifier; at 0, strong strokes over rough objects
    clip."""
    tilt: float = 0.0
    """Degrees between the bed's axis and the surface's normal (`Finger.tilted`)."""
    levels: str = field(default=FIRST, repr=False)
    """Gains and noise, one of `~tactophone_lab.simulation.recording_levels.LEVELS`. Not
    in the ``repr`` that rendered files are hashed by, so that the files of the shipped
    models' cards keep their hash."""
    room_sound: RoomSound | None = field(default=None, repr=False)
    """A sound that plays in the room."""


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
        words = self.object.name.replace(", ", "-").replace(" ", "-").lower()
        folder = f"{self.object.number:02}-{words}"
        return f"{folder}/{self.mounting}/{self.take.name}.flac"

    @property
    def fingerprint(self) -> str:
        """A hash of everything that the sound depends on."""
        tip = tip_named(self.options.tip)
        chosen = self.options.levels
        levels = "" if chosen == FIRST else repr(LEVELS[chosen])
        room_sound = (
            self.options.room_sound.fingerprint if self.options.room_sound else ""
        )
        return hashlib.sha256(
            f"{RENDER_VERSION} {self!r} {SessionVariation()!r} {tip!r}{levels}"
            f"{room_sound}".encode()
        ).hexdigest()[:16]

    @property
    def session(self) -> int:
        """Seed of the set-up, which the seven takes of an object in a mounting
        share."""
        mounting = list(Mounting).index(self.mounting)
        return int(
            np.random.SeedSequence(
                [self.options.seed, self.object.number, mounting]
            ).generate_state(1)[0]
        )


def plan_dataset(
    objects: Sequence[SimulatedObject],
    options: RenderOptions,
    *,
    scenarios: bool = False,
    takes: Sequence[Take] = TAKES,
) -> tuple[RenderJob, ...]:
    """List the recordings: each object as the catalogue mounts it, movable ones with
    ``scenarios`` in all three."""
    return tuple(
        RenderJob(obj, mounting, take, options)
        for obj in objects
        for mounting in (SCENARIOS if scenarios and obj.movable else (obj.mounting,))
        for take in takes
    )


COMPRESSED = 0.4
"""Least share of the bytes of its samples that a FLAC file of simulated sound takes."""


def check_room(folder: Path, jobs: Sequence[RenderJob]) -> None:
    """Raise `DatasetError` if recordings do not fit on the disk of a folder even if
    they compress well."""
    channels = 2
    seconds = sum(job.options.duration for job in jobs)
    bytes_a_sample = max((job.options.bits for job in jobs), default=0) / 8
    samples = channels * LIVE_SAMPLE_RATE * seconds
    needed = COMPRESSED * bytes_a_sample * samples
    existing = [each for each in (folder, *folder.absolute().parents) if each.exists()]
    free = shutil.disk_usage(existing[0]).free
    if needed > free:
        raise DatasetError(
            f"{folder}: {seconds:.0f} s of sound take {needed / 1e9:.1f} GB or more, "
            f"but {free / 1e9:.1f} GB are free: render fewer or shorter takes, or "
            "write elsewhere"
        )


def render_dataset(
    folder: Path, jobs: Sequence[RenderJob], *, processes: int = 1
) -> Iterator[RenderJob]:
    """Render the missing recordings; yields each job when it is done, existing ones
    first.

    Call :func:`write_manifest` afterwards, also after an interruption. Raises
    `DatasetError` if they do not fit on the disk, or a manifest that is there could not
    be written again.
    """
    read_to_rewrite(folder)
    missing = []
    for job in jobs:
        if _metadata(folder, job):
            yield job
        else:
            missing.append(job)
    check_room(folder, missing)
    if processes == 1 or len(missing) < 2:
        yield from (_write(folder, job) for job in missing)
        return
    # The first job compiles the kernels; started at once, every process would compile
    # them again.
    yield _write(folder, missing.pop(0))
    with open_pool(processes) as pool:
        try:
            for future in as_completed(
                [pool.submit(_write, folder, job) for job in missing]
            ):
                yield future.result()
        finally:
            pool.shutdown(cancel_futures=True)


def write_manifest(folder: Path, jobs: Sequence[RenderJob]) -> int:
    """Write the finished jobs into ``metadata.csv``, where other lines stay; return
    their number. The authors' layout has no manifest."""
    recordings = [
        _recording(folder, job, metadata)
        for job in jobs
        if (metadata := _metadata(folder, job))
    ]
    if recordings and not jobs[0].options.authors_layout:
        add_to_metadata(folder, recordings)
    return len(recordings)


def render(job: RenderJob) -> tuple[FloatArray, Truth]:
    """Render one recording: the sound, shape ``(samples, 2)`` at 48 kHz, and the ground
    truth."""
    scene = single(job.object, job.mounting)
    noise = [job.options.seed, job.session, TAKES.index(job.take)]
    wired = electronics(job.options.levels, hall=job.options.hall, tip=job.options.tip)
    session = SessionVariation.draw(job.session, wired, tip=job.options.tip)
    session = replace(
        session,
        electronics=session.electronics.amplified(job.options.gain_db),
        finger=session.finger.tilted(job.options.tilt),
    )
    finger = SimulatedFinger(
        scene,
        _moves(job, scene),
        session=session,
        seed=noise,
        place=scene.placed[0].centre,
    )
    samples = finger.render(round(job.options.duration * LIVE_SAMPLE_RATE)).samples
    if room_sound := job.options.room_sound:
        heard = room_sound.heard(len(samples), np.random.default_rng(noise))
        samples = np.clip(samples + heard, -1.0, 1.0)
    samples = through_opus(samples) if job.options.opus else samples
    return samples, finger.truth


def through_opus(samples: FloatArray) -> FloatArray:
    """Return sound as the link's codec passes it, without its look-ahead: the paper did
    so with its training sound."""
    codec = Codec("opus", channels=2, packet_size=480, bandwidth=20_000)
    return encode_and_decode(samples, codec)


def _metadata(folder: Path, job: RenderJob) -> RenderMetadata | None:
    """Metadata of the job's file, or ``None`` if the file is missing or was rendered
    otherwise."""
    metadata = read_render_metadata(folder / job.name)
    return metadata if metadata and metadata.fingerprint == job.fingerprint else None


def _slides(job: RenderJob, metadata: RenderMetadata) -> Intervals:
    """Intervals in which the finger touches something and moves faster than
    `SLIDING`."""
    scene = single(job.object, job.mounting)
    x, y = scene.placed[0].centre
    hand = MoveFollower(scene.field, x=x, y=y, rate=LIVE_SAMPLE_RATE)
    hand.queue(_moves(job, scene))
    speed = np.abs(
        hand.follow(round(job.options.duration * LIVE_SAMPLE_RATE)).motion.speed
    )
    time = np.arange(len(speed)) / LIVE_SAMPLE_RATE
    sliding = (speed > SLIDING) & within(
        time, (segment for segment in metadata.segments if segment.contact)
    )
    return tuple(
        (float(start), float(end))
        for start, end in stretches(sliding) / LIVE_SAMPLE_RATE
    )


def _recording(folder: Path, job: RenderJob, metadata: RenderMetadata) -> Recording:
    roughness = job.object.roughness
    room_sound = job.options.room_sound
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
        **({"gain_db": f"{job.options.gain_db:g}"} if job.options.gain_db else {}),
        **({"tilt": f"{job.options.tilt:g}"} if job.options.tilt else {}),
        **({"levels": job.options.levels} if job.options.levels != FIRST else {}),
        **({"room_sound": room_sound.path.name} if room_sound else {}),
    }
    return Recording(
        folder / job.name,
        job.object.surface.name,
        Touch(job.object.label)
        if job.object.label
        else None,  # measured surfaces have none
        ("contact", "air"),
        take=job.take.name,
        scenario=str(job.mounting),
        session=f"{job.session:08x}",
        segments=metadata.segments,
        properties=properties,
    )


def _moves(job: RenderJob, scene: Scene) -> list[Move]:
    seed = np.random.SeedSequence(
        [job.options.seed, job.session, TAKES.index(job.take)]
    )
    rng = np.random.default_rng(seed.spawn(1)[0])
    return take_moves(job.take, scene.placed[0], duration=job.options.duration, rng=rng)


def _write(folder: Path, job: RenderJob) -> RenderJob:
    samples, truth = render(job)
    segments = touch_segments(truth.object_index, single(job.object, job.mounting))
    write_sound(
        folder / job.name,
        samples,
        RenderMetadata(job.fingerprint, segments),
        bits=job.options.bits,
    )
    return job
