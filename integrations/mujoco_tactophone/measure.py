"""Measure the microphone of MuJoCo against the simulated finger: ``python measure.py``,
about two minutes.

Third-octaves of the same strokes, cost in one run, and what the shipped detector
renders of the ten frozen objects: the takes of `docs/research/scores.md`, their moves
led through MuJoCo. The rules: no third-octave differs by over 1 dB, the cost is at most
1.5 times the finger's, and as rendered the balanced accuracy is at least the frozen
score of 0.79. All of it is simulated.
"""

import sys
import time
from collections.abc import Sequence
from pathlib import Path
from tempfile import TemporaryDirectory

import mujoco
import numpy as np
from mujoco_tactophone import ContactMicrophone
from mujoco_tactophone.world import STEP, pressed, stones_model

from tactophone import LIVE_SAMPLE_RATE, Touch
from tactophone.signal.perception.model_file import read_model
from tactophone.signal.perception.models import model_path
from tactophone_lab.datasets.open import open_dataset
from tactophone_lab.evaluation.predict import recording_predictor
from tactophone_lab.evaluation.scores import rendered_scores
from tactophone_lab.simulation.catalogue import find
from tactophone_lab.simulation.microphone_models import SessionVariation
from tactophone_lab.simulation.motion import Move, single
from tactophone_lab.simulation.render import (
    RenderJob,
    RenderMetadata,
    RenderOptions,
    plan_dataset,
    touch_segments,
    write_manifest,
    write_sound,
)
from tactophone_lab.simulation.source import SimulatedFinger
from tactophone_lab.simulation.strokes import take_moves
from tactophone_lab.simulation.takes import TAKES

sys.path.insert(0, str(Path(__file__).parent / "tests"))
from test_mujoco import STONES, beside, thirds

FROZEN = range(23, 33)
QUIET = ("long_medium", "short_light", "wiggle")
OPTIONS = RenderOptions(duration=6.0, seed=31)
"""As `make sets` renders the frozen objects under the pad."""

PERIOD = 5
"""Steps of the physics between two blocks of sound."""


def print_thirds() -> None:
    """Print the differences from the simulated finger, in dB."""
    for seconds in (7.0, 30.0):
        for name in STONES:
            sound, reference = beside(name, seconds)
            apart = thirds(sound) - thirds(reference)
            words = (
                f"{each.mean():+.2f} (worst {np.abs(each).max():.2f})" for each in apart
            )
            print(
                f"{name}, {seconds:.0f} s: contact {', air '.join(words)} dB",
                flush=True,
            )


def moves_of(job: RenderJob) -> list[Move]:
    """Return the moves of a take, as the data set has them."""
    seed = np.random.SeedSequence(
        [job.options.seed, job.session, TAKES.index(job.take)]
    )
    placed = single(job.object, job.mounting).placed[0]
    return take_moves(
        job.take,
        placed,
        duration=job.options.duration,
        rng=np.random.default_rng(seed.spawn(1)[0]),
    )


def finger_of(job: RenderJob, **words: object) -> SimulatedFinger:
    """Return the data set's finger, with its mounting and noise."""
    scene, session = (
        single(job.object, job.mounting),
        SessionVariation.draw(job.session, tip=job.options.tip),
    )
    noise = [job.options.seed, job.session, TAKES.index(job.take)]
    return SimulatedFinger(
        scene, session=session, seed=noise, place=scene.placed[0].centre, **words
    )


class Alone:
    """The simulated finger, led by the moves."""

    def __init__(self, job: RenderJob) -> None:
        self.finger, self.spent = finger_of(job), 0.0
        for move in moves_of(job):
            self.finger.move(*move[1:], time=move.time)

    def block(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the next sound, and what is touched."""
        begun = time.process_time()
        block = self.finger.render(round(PERIOD * STEP * LIVE_SAMPLE_RATE))
        self.spent += time.process_time() - begun
        return block.samples, self.finger.truth.object_index


class InMujoco:
    """The same finger, led by MuJoCo's physics, whose arm is led by the moves."""

    def __init__(self, job: RenderJob) -> None:
        (placed,) = single(job.object, job.mounting).placed
        self._model = stones_model([str(job.object.number)], placed.width)
        self._data, self._step, self._moves, self._centre = (
            mujoco.MjData(self._model),
            0,
            moves_of(job),
            placed.centre,
        )
        self._microphone = ContactMicrophone(
            self._model, self._data, "tip", mounting=job.mounting
        )
        self._microphone.finger = finger_of(job, hand=self._microphone)
        self.spent = self.physics = 0.0

    def block(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the next sound, and what is touched."""
        for _ in range(PERIOD):
            while len(self._moves) > 1 and self._moves[1].time <= self._step * STEP:
                del self._moves[0]
            _, x, y, force = self._moves[0]
            self._data.ctrl[:] = (
                x - self._centre[0],
                y - self._centre[1],
                pressed(force, self._data.qpos[2]),
            )
            begun = time.process_time()
            mujoco.mj_step(self._model, self._data)
            stepped = time.process_time()
            self._microphone.step()
            self.physics, self.spent = (
                self.physics + stepped - begun,
                self.spent + time.process_time() - stepped,
            )
            self._step += 1
        begun = time.process_time()
        block = self._microphone.read()
        self.spent += time.process_time() - begun
        return block.samples, self._microphone.finger.truth.object_index


def write(folder: Path, job: RenderJob, take: Alone | InMujoco) -> None:
    """Write a take with what is truly touched."""
    blocks = [take.block() for _ in range(round(job.options.duration / STEP / PERIOD))]
    sound, touched = (np.concatenate(parts) for parts in zip(*blocks, strict=True))
    segments = touch_segments(touched, single(job.object, job.mounting))
    write_sound(folder / job.name, sound, RenderMetadata(job.fingerprint, segments))


def scored(folder: Path, jobs: Sequence[RenderJob]) -> dict[str, float]:
    """Return the share of each surface that the shipped detector renders right."""
    write_manifest(folder, jobs)
    predict, rule = (
        recording_predictor("texture"),
        read_model(model_path("texture")).card.decision,
    )
    takes: dict[str, list] = {}
    for recording in open_dataset(folder).labelled().recordings:
        takes.setdefault(recording.surface, []).append(predict(recording))
    return {
        name: rendered_scores(found, rule, draws=0).balanced_accuracy.value
        for name, found in takes.items()
    }


def interval(shares: np.ndarray, rough: np.ndarray) -> str:
    """Return the mean of the two classes with a 95 % interval over surfaces."""
    rng, classes = np.random.default_rng(0), (shares[rough], shares[~rough])
    drawn = [
        np.mean([rng.choice(each, len(each)).mean() for each in classes])
        for _ in range(10_000)
    ]
    low, high = np.quantile(drawn, [0.025, 0.975])
    return f"{np.mean([each.mean() for each in classes]):.3f} ({low:.3f} to {high:.3f})"


def print_detector_and_cost() -> None:
    """Print what the detector renders of the frozen objects, and the cost of each way,
    by processor time."""
    takes = [take for take in TAKES if take.name in QUIET]
    jobs, spent = (
        plan_dataset([find(str(number)) for number in FROZEN], OPTIONS, takes=takes),
        [],
    )
    with TemporaryDirectory() as folder:
        alone, physics = Path(folder) / "alone", Path(folder) / "mujoco"
        for job in jobs:
            ways = Alone(job), InMujoco(job)
            for place, way in zip((alone, physics), ways, strict=True):
                write(place, job, way)
            spent.append((ways[0].spent, ways[1].spent, ways[1].physics))
        own, theirs = scored(alone, jobs), scored(physics, jobs)
    labels = {job.object.surface.name: job.object.label is Touch.ROUGH for job in jobs}
    rough = np.array([labels[name] for name in own])
    shares = np.array([[own[name], theirs[name]] for name in own]).T
    for name, first, second, label in zip(own, *shares, rough, strict=True):
        print(
            f"{name}, {'rough' if label else 'smooth'}: {first:.2f}, in MuJoCo "
            f"{second:.2f}"
        )
    for name, each in (
        ("alone", shares[0]),
        ("in MuJoCo", shares[1]),
        ("difference", shares[1] - shares[0]),
    ):
        print(f"as rendered, {name}: {interval(each, rough)}")
    reference, microphone, stepped = np.array(spent[2:]).T  # the first two compile
    low, ratio, high = np.quantile(microphone / reference, [0.25, 0.5, 0.75])
    print(
        f"cost of step and read over the finger's: {ratio:.2f} (quartiles {low:.2f} "
        f"to {high:.2f})"
    )
    print(
        f"with the physics: {(stepped + microphone).mean() / OPTIONS.duration:.2f} of "
        "real time"
    )


if __name__ == "__main__":
    print_thirds()
    print_detector_and_cost()
