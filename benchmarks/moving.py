"""How much of a robot's motion in the air is contact, and how late contact is while it
starts or stops.

    python benchmarks/moving.py [--seeds 10] [--data DIR --model NAME]

SIMULATED: an arm with gears and jerks (`ARM`) moves in the air for 10 s, with three
starts and stops, then moves to an object and strokes it; without and with the arm
saying when it moves. Where TACTOPHONE_RECORDINGS names a folder with `gripper`, its
take in the air too, whose start is known from its laser. With ``--data`` only: what a
model renders right of a data set, as it is and with that gripper added (`distortions`);
of `lmt`, two takes of each surface of the tiers core and extended, within 30 dB of the
loudest.
"""

import argparse
import os
import tempfile
from collections.abc import Callable, Iterator, Sequence
from functools import partial
from pathlib import Path

import numpy as np
import soundfile
from numpy.typing import NDArray

from cells import in_ms
from distortions import GROUPS, distorted
from rendered_real import AS_IT_IS, AUDIBLE_DB
from tactophone.core.recordings.values import Recording
from tactophone.core.types import AudioBlock, FloatArray, Touch
from tactophone.signal.perception.calibration import (
    CalibrationSounds,
    measure_calibration,
)
from tactophone.signal.perception.contact import ContactGate
from tactophone.signal.perception.model_file import read_model
from tactophone.signal.perception.models import model_path
from tactophone.signal.perception.noise_floor import BAND_MARGIN_DB, NoiseFloor
from tactophone_lab.datasets.open import open_dataset
from tactophone_lab.evaluation.bumps_and_delays import decided_touches
from tactophone_lab.evaluation.predict import recording_predictor
from tactophone_lab.simulation.catalogue import find
from tactophone_lab.simulation.microphone_models import Electronics
from tactophone_lab.simulation.participant import SimulatedParticipant
from tactophone_lab.training.recipe_options import FeatureSpec
from tactophone_lab.training.tracks import extract_features

OBJECTS = ("whiteboard", "brick", "lava stone", "polished marble", "glazed tile")
ARM = Electronics(gear_dbfs=-50.0, jerk_dbfs=-34.0)
"""A robot whose motion is as loud over its noise as the recorded gripper's."""
PACKET = 120
STANDS_UNDER = 0.02
"""Share of the motors' greatest speed."""
LASER_START = 2.15
"""Seconds into `gripper`'s take in the air at which the laser hears it start."""

TAKES = 2

Rows = list[tuple[str, list[float]]]


def gated(
    sound: FloatArray,
    rate: int,
    moving: NDArray[np.bool_],
    *,
    bands: bool = True,
    margin_db: float = BAND_MARGIN_DB,
) -> NDArray[np.bool_]:
    """Return whether there is contact, per packet."""
    floor = NoiseFloor(-26.0)
    floor.margin_db = margin_db
    gate = ContactGate(
        -26.0, sample_rate=rate, rule="banded", floor=floor, bands=bands, hold=0.1
    )
    found, touching = [], False
    for number, moves in enumerate(moving.tolist()):
        part = sound[number * PACKET : (number + 1) * PACKET]
        for contact in gate.push(AudioBlock(part, rate, number * PACKET, moving=moves)):
            touching = contact.touching
        found.append(touching)
    return np.array(found)


class Performed:
    """A simulated arm's sound, and per packet whether it moves and touches."""

    def __init__(self, name: str, seed: int) -> None:
        self.participant = SimulatedParticipant(
            find(name), gain_db=-12.0, seed=seed, electronics=ARM
        )
        self.sound: list[FloatArray] = []
        self.moving: list[bool] = []
        self.touching: list[bool] = []

    def follow(self, seconds: float, act: Callable[[], None]) -> slice:
        """Perform an act; return its packets."""
        begun = len(self.moving)
        act()
        finger = self.participant._finger
        for _ in range(round(seconds * 48_000 / PACKET)):
            contacts = finger.touch(PACKET)
            self.sound.append(finger.record(contacts).samples)
            self.participant._now = finger._position / 48_000
            self.moving.append(bool(contacts.motor.max() >= STANDS_UNDER))
            self.touching.append(bool((finger.truth.object_index >= 0).any()))
        return slice(begun, len(self.moving))


def simulated(seeds: int) -> Rows:
    """Return contact in the air, and the time from touch to contact, of each rule, in
    the mean over seeds."""
    air: dict[str, list[float]] = {}
    late: dict[str, list[float]] = {}
    margins = []
    for seed in range(seeds):
        arm = Performed(OBJECTS[seed % len(OBJECTS)], seed)
        arm.follow(0.5, arm.participant.rest)
        rest = arm.follow(5.0, arm.participant.rest)
        motion = arm.follow(10.0, partial(arm.participant.move, 10.0))
        stroke = arm.follow(5.0, partial(arm.participant.stroke, 4.5))
        sound, moving, touching = (
            np.concatenate(arm.sound),
            np.array(arm.moving),
            np.array(arm.touching),
        )
        parts = [
            sound[PACKET * each.start : PACKET * each.stop]
            for each in (rest, stroke, stroke, motion)
        ]
        margin = measure_calibration(
            CalibrationSounds(48_000, *parts), made="", source=""
        ).calibration.margin_db
        margins.append(margin)
        still = np.zeros_like(moving)
        for words, found in {
            "level": gated(sound, 48_000, still, bands=False),
            "bands": gated(sound, 48_000, still),
            "bands, the arm says that it moves": gated(sound, 48_000, moving),
            "the same, with the margin that `check` finds, {margins}": gated(
                sound, 48_000, moving, margin_db=margin
            ),
        }.items():
            air.setdefault(words, []).append(100 * float(found[motion].mean()))
            begins = np.flatnonzero(touching[stroke])[0] + stroke.start
            after = np.flatnonzero(found[begins:])
            late.setdefault(words, []).append(
                1000 * PACKET / 48_000 * (after[0] if len(after) else np.inf)
            )
    named = f"{min(margins):.1f} to {max(margins):.1f} dB"
    return [
        (
            words.format(margins=named),
            [
                float(np.mean(air[words])),
                *np.quantile(late[words], (0.5, 0.95)).tolist(),
            ],
        )
        for words in air
    ]


def recorded(folder: Path) -> Rows:
    """Return contact in the take in the air of the real gripper, of each rule."""
    sound, rate = soundfile.read(
        folder / "pencil_moveOnly.flac", dtype="float32", always_2d=True
    )
    moving = np.arange(len(sound) // PACKET) * PACKET / rate >= LASER_START
    still = np.zeros_like(moving)
    rules = {
        "level": gated(sound, rate, still, bands=False),
        "bands": gated(sound, rate, still),
        "bands, the arm says that it moves": gated(sound, rate, moving),
    }
    return [(words, [100 * float(found.mean())]) for words, found in rules.items()]


def rendered_right(
    recordings: Sequence[Recording], name: str
) -> Iterator[tuple[str, list[float]]]:
    """Yield for each channel the shares of rough and smooth rendered right, and of both
    not at all."""
    model = read_model(model_path(name))
    card, predict = model.card, recording_predictor(model)
    spec = FeatureSpec(channels=card.channels, microphone=card.microphone)
    with tempfile.TemporaryDirectory() as folder:
        for channel in (AS_IT_IS, *GROUPS["robot"]):
            counts = {True: np.zeros(3), False: np.zeros(3)}
            for take in recordings:
                heard = (
                    take
                    if channel == AS_IT_IS
                    else distorted(take, channel, Path(folder))
                )
                (track,) = extract_features([take], spec)
                audible = track.end[
                    track.level_dbfs >= track.level_dbfs.max() - AUDIBLE_DB
                ]
                found = predict(heard)
                newest = np.searchsorted(found.time, audible + 1e-6) - 1
                decided = decided_touches(found, card.decision)[newest]
                counts[bool(take.rough)] += np.bincount(decided, minlength=3)
            rough, smooth = (
                counts[label] / counts[label].sum() for label in (True, False)
            )
            gaps = sum(each[Touch.NONE] for each in counts.values()) / sum(
                each.sum() for each in counts.values()
            )
            yield channel, [rough[Touch.ROUGH], smooth[Touch.SMOOTH], gaps]


def main() -> None:
    """Print the tables."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--seeds", type=int, default=10, help="simulated arms (default: %(default)s)"
    )
    parser.add_argument(
        "--data", type=Path, metavar="DIR", help="recordings; nothing else is measured"
    )
    parser.add_argument(
        "--model", default="texture", help="with --data (default: %(default)s)"
    )
    args = parser.parse_args()
    if args.data:
        takes = open_dataset(args.data).labelled().recordings
        takes = [
            take
            for take in takes
            if take.tier in ("core", "extended", "")
            and (not take.take.isdigit() or int(take.take) <= TAKES)
        ]
        print(
            "| sound added | rough right | smooth right | nothing rendered "
            "|\n|---|--:|--:|--:|"
        )
        for channel, shares in rendered_right(takes, args.model):
            print("| {} | {:.3f} | {:.3f} | {:.3f} |".format(channel, *shares))
        return
    print(
        "| SIMULATED arm | contact in the air, of the time | touch to contact, p50 "
        "| p95 |\n|---|--:|--:|--:|"
    )
    for words, (share, *late) in simulated(args.seeds):
        print(f"| {words} | {share:.1f} % | {in_ms(late[0])} | {in_ms(late[1])} |")
    gripper = Path(os.environ.get("TACTOPHONE_RECORDINGS", "")) / "gripper"
    if gripper.is_dir():
        print("\n| gripper, real | contact in the air, of the take |\n|---|--:|")
        for words, (share,) in recorded(gripper):
            print(f"| {words} | {share:.1f} % |")


if __name__ == "__main__":
    main()
