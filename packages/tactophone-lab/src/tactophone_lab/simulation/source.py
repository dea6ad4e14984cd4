"""The simulated finger: moves in, the sound of two microphones out; the same contract
as a sound device.

In a simulated hand each finger has a contact of its own, and some of each contact
reaches its neighbours. No published figure for a robot's hand was found, so the levels
here are reasoned; docs/guide/hand.md has false touches over a range of them.

*Through the structure.* A finger's force shakes the palm through its last joint, and
the palm shakes the next finger's. Both joints are suspensions of 48 Hz, above which
each transmits 12 dB less an octave, and the palm has some six times the mass of a link:
-16 dB. At 100 Hz that is -16 - 13 = -29 dB and less above. Here: -26 dB, low-passed at
100 Hz, and 6 dB less for each finger further on.

*Through the air.* Pressure falls with the distance: a neighbour's contact is 20 mm down
and 25 mm aside of an air microphone, its own 20 mm down. That is -4 dB for the next
finger, -9 dB for the one after it.
"""

import math
from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple, Protocol

import numpy as np
from numpy.typing import NDArray
from scipy import signal

from tactophone.core.types import LIVE_SAMPLE_RATE, AlwaysOpen, AudioBlock
from tactophone_lab.simulation.catalogue import SimulatedObject
from tactophone_lab.simulation.contact import (
    BODY,
    CONTACT_STATE,
    OVERSAMPLING,
    ContactSignals,
    Ground,
    Ringing,
    slide,
)
from tactophone_lab.simulation.finger import Finger
from tactophone_lab.simulation.mechanics import compiled
from tactophone_lab.simulation.microphone_models import (
    NORMALS,
    Microphones,
    SessionVariation,
)
from tactophone_lab.simulation.modes import body_modes, mode_table, plate_pressure
from tactophone_lab.simulation.motion import Move, MoveFollower, Path, Scene
from tactophone_lab.simulation.surface import HEIGHT_SPACING, Track, track

MOTOR_SPEED = 0.15
"""Metres a second at which the arm's motors are at their loudest."""

SPEED_HOLD = 0.02
"""Seconds that a touch outlasts the force: a finger that bounces from grain to grain
has not left the object."""


@dataclass(frozen=True, slots=True, eq=False)
class Truth:
    """Ground truth of a block, per sample.

    - ``touch``: int8: :class:`~tactophone.core.types.Touch`; ``NONE`` on the ground,
      which is neither smooth nor rough.
    - ``object_index``: int16: index into the scene's ``objects``, where the ground is
      the last; -1 in the air.
    - ``force``: contact force, in N.
    - ``x``, ``y``: place of the finger, in m.
    """

    touch: NDArray[np.int8]
    object_index: NDArray[np.int16]
    force: NDArray[np.float32]
    x: NDArray[np.float64]
    y: NDArray[np.float64]


class Contacts(NamedTuple):
    """What the microphones convert to sound (`Microphones.convert`): forces and
    pressures, motors, unit noise."""

    signals: ContactSignals
    motor: NDArray[np.float64]
    normals: NDArray[np.float64]


class Leads(Protocol):
    """What leads a finger over its scene."""

    def follow(self, size: int) -> Path: ...


class SimulatedFinger(AlwaysOpen):
    """A finger over a scene, as a :class:`~tactophone.core.types.Source`.

    It renders on demand and reads no clock: in a live system, the caller paces it. The
    same moves and seeds give bit-equal samples at any block size.

    - ``scene``: objects and ground under it.
    - ``moves``: its moves, oldest first; :meth:`move` adds more at any time.
    - ``session``, ``seed``: the session's set-up, and the seed of all noise.
    - ``duration``: seconds after which iteration ends; never, if ``None``. The
      attribute ``end`` has it in samples.
    - ``block_size``: samples per block of iteration.
    - ``place``: where it hovers at the start, in m.
    - ``hand``: what leads it in place of moves, such as the finger of a physics engine:
      its ``follow(size)`` returns a `Path`.

    >>> from tactophone_lab.simulation.catalogue import find
    >>> from tactophone_lab.simulation.motion import single
    >>> finger = SimulatedFinger(single(find("lava stone")), place=(0.02, 0.03))
    >>> finger.move(0.06, 0.03, 1.5)
    >>> block = finger.render(480)
    >>> block.samples.shape, block.sample_rate, finger.truth.touch.shape
    ((480, 2), 48000, (480,))
    """

    sample_rate = LIVE_SAMPLE_RATE
    channels = 2

    def __init__(
        self,
        scene: Scene,
        moves: Iterable[Move] = (),
        *,
        session: SessionVariation | None = None,
        seed: int | Sequence[int] = 0,
        duration: float | None = None,
        block_size: int = 480,
        place: tuple[float, float] = (0.0, 0.0),
        hand: Leads | None = None,
    ) -> None:
        session = session or SessionVariation()
        self.scene = scene
        self._finger = session.finger
        self.end = None if duration is None else round(duration * LIVE_SAMPLE_RATE)
        self._block_size = block_size
        self._position = 0
        self._hand = MoveFollower(
            scene.field, x=place[0], y=place[1], rate=LIVE_SAMPLE_RATE
        )
        self._hand.queue(moves)
        self._follow = self._hand.follow if hand is None else hand.follow
        self._rng = np.random.default_rng(
            np.random.SeedSequence([0xF1A6, *np.atleast_1d(seed)])
        )
        self._ground = _ground(scene, session)
        # The finger hovers, and nothing rings.
        self._state = np.zeros(1, CONTACT_STATE)
        self._state["arm"] = self._state["pad"] = session.finger.arm_rest
        self._ringing = Ringing(
            np.zeros(self._ground.modes.shape), np.zeros(self._ground.modes.shape)
        )
        self._microphones = Microphones(
            session.electronics,
            scene.objects[0].mounting,  # determines the room around the finger
            seed=np.random.SeedSequence([0x3E35, session.seed]),
            rate=LIVE_SAMPLE_RATE,
        )
        self._labels = np.array([obj.label for obj in scene.objects], np.int8)
        self._since_touch = np.array([LIVE_SAMPLE_RATE, -1])
        self.truth = Truth(
            np.empty(0, np.int8),
            np.empty(0, np.int16),
            np.empty(0, np.float32),
            np.empty(0),
            np.empty(0),
        )

    def __iter__(self) -> Iterator[AudioBlock]:
        while self.end is None or self._position < self.end:
            left = self._block_size if self.end is None else self.end - self._position
            yield self.render(min(self._block_size, left))

    def move(self, x: float, y: float, force: float, time: float | None = None) -> None:
        """Queue a target: ``x, y`` (m) and ``force`` (N; negative lifts), at ``time``
        (s) or now.

        May be called from any thread.
        """
        self._hand.queue(
            [
                Move(
                    self._position / LIVE_SAMPLE_RATE if time is None else time,
                    x,
                    y,
                    force,
                )
            ]
        )

    def render(self, size: int) -> AudioBlock:
        """Return the next ``size`` samples; their ground truth is in ``truth``
        afterwards."""
        return self.record(self.touch(size))

    def touch(self, size: int) -> Contacts:
        """Simulate the contact of the next ``size`` samples, which `record` turns into
        sound."""
        path = self._follow(size)
        normals = self._rng.standard_normal((size, OVERSAMPLING + NORMALS))
        signals = ContactSignals(*(np.empty(size) for _ in ContactSignals._fields))
        noise = np.ascontiguousarray(normals[:, :OVERSAMPLING])
        slide(
            path.motion,
            noise,
            self._ground,
            self._finger,
            self._state,
            self._ringing,
            signals,
            float(LIVE_SAMPLE_RATE),
        )
        motor = np.minimum(1.0, np.abs(path.motion.speed) / MOTOR_SPEED)
        index = np.empty(size, np.int16)
        _touched(
            signals.force,
            path.motion.body,
            index,
            self._since_touch,
            int(SPEED_HOLD * LIVE_SAMPLE_RATE),
        )
        touch = np.where(index < 0, np.int8(0), self._labels[index])
        self.truth = Truth(
            touch, index, signals.force.astype(np.float32), path.x, path.y
        )
        return Contacts(signals, motor, np.ascontiguousarray(normals[:, OVERSAMPLING:]))

    def record(self, contacts: Contacts) -> AudioBlock:
        """Return the sound of contacts: the finger's own, and what reaches it through
        a hand."""
        samples = self._microphones.convert(*contacts)
        size = len(contacts.motor)
        block = AudioBlock(samples, LIVE_SAMPLE_RATE, self._position)
        self._position += size
        return block


def _ground(scene: Scene, session: SessionVariation) -> Ground:
    """Make the kernel's tables of all that can be touched."""
    objects = scene.objects
    finger = session.finger
    flexure = session.flexure
    tracks = [
        track(obj.surface, obj.material, finger.tip_radius, finger.tip_modulus)
        for obj in objects
    ]
    modes = [
        body_modes(
            obj.body,
            obj.mounting,
            mass=obj.mass,
            rng=np.random.default_rng([session.seed, 7, k]),
        )
        for k, obj in enumerate(objects)
    ]
    bodies = np.zeros(len(objects), BODY)
    for body, obj, traced, ringing in zip(bodies, objects, tracks, modes, strict=True):
        _fill(body, obj, traced, finger)
        body["plate_share"] = _share(max(mode.frequency for mode in ringing))
        body["modes"] = len(ringing)
    size = max(len(flexure), *map(len, modes))
    return Ground(
        light=np.stack([each.light for each in tracks]),
        heavy=np.stack([each.heavy for each in tracks]),
        friction=np.stack([each.friction for each in tracks]),
        spacing=HEIGHT_SPACING,
        bodies=bodies,
        modes=np.stack([mode_table(ringing, size) for ringing in (*modes, flexure)]),
        flexure=len(flexure),
    )


def _fill(body: np.void, obj: SimulatedObject, traced: Track, finger: Finger) -> None:
    material = obj.material
    mechanics = traced.mechanics
    body["stiffness"] = mechanics.hertz_stiffness
    # Adhesion goes with the true contact area: a hard tip on stone hardly sticks,
    # whatever is polished.
    body["kinetic"] = material.kinetic
    body["static"] = material.kinetic + min(mechanics.adhesion, 1.0) * (
        material.static - material.kinetic
    )
    body["stribeck_speed"], body["hiss"] = (
        material.stribeck_speed,
        mechanics.adhesion * material.hiss,
    )
    body["hiss_share"] = _share(mechanics.tangential_corner(finger.pad_mass))
    body["plate"] = plate_pressure(obj.body, finger.air_distance)


def _share(frequency: float) -> float:
    """Return the coefficient of a one-pole low-pass with this corner in Hz, at the
    kernel's step."""
    return float(1 - np.exp(-2 * np.pi * frequency / (OVERSAMPLING * LIVE_SAMPLE_RATE)))


@compiled
def _touched(
    force: NDArray[np.float64],
    body: NDArray[np.int64],
    object_index: NDArray[np.int16],
    since: NDArray[np.int64],
    hold: int,
) -> None:
    """Write the touched object's index per sample; ``since`` holds the samples since
    the last force, and its object."""
    for i in range(force.size):
        since[0] += 1
        if force[i] > 0.0:
            since[0], since[1] = 0, body[i]
        object_index[i] = since[1] if since[0] <= hold else -1


STRUCTURE_DB = -26.0
"""Level of a neighbour's force at a finger's piezo, relative to the neighbour's own."""

FURTHER_DB = -6.0
"""Additional level for each finger further on."""

CORNER = 100.0
"""Hz above which the structure transmits less."""

GRAIN_PITCH = 0.025
"""Metres from fingertip to fingertip."""

BELOW = 0.02
"""Metres from an air microphone down to its finger's contact."""


class SimulatedHand:
    """Several simulated fingers in one structure and one air, two channels of sound for
    each.

    - ``fingers``: from thumb to little finger, each with its own moves.
    - ``structure_db``: level of what reaches the next finger through the hand; -inf is
      none.
    """

    sample_rate = LIVE_SAMPLE_RATE

    def __init__(
        self, fingers: Sequence[SimulatedFinger], *, structure_db: float = STRUCTURE_DB
    ) -> None:
        self.fingers, self.channels = list(fingers), 2 * len(fingers)
        apart = np.abs(
            np.subtract.outer(np.arange(len(fingers)), np.arange(len(fingers)))
        )
        self._structure = np.where(
            apart > 0, 10 ** ((structure_db + FURTHER_DB * (apart - 1)) / 20), 0.0
        )
        self._air = np.where(
            apart > 0, BELOW / np.hypot(BELOW, GRAIN_PITCH * apart), 0.0
        )
        if math.isinf(structure_db):
            self._structure, self._air = (
                np.zeros_like(self._structure),
                np.zeros_like(self._air),
            )
        self._sections = signal.butter(2, CORNER, fs=LIVE_SAMPLE_RATE, output="sos")
        self._state = np.zeros((len(self._sections), len(fingers), 2))

    def render(self, size: int) -> AudioBlock:
        """Return the next ``size`` samples of all fingers."""
        if len(self.fingers) == 1:
            return self.fingers[0].render(size)
        contacts = [finger.touch(size) for finger in self.fingers]
        strains = self._structure @ np.stack([each.signals.strain for each in contacts])
        strains, self._state = signal.sosfilt(
            self._sections, strains, axis=1, zi=self._state
        )
        pressures = self._air @ np.stack(
            [each.signals.finger + each.signals.body for each in contacts]
        )
        blocks = []
        for finger, own, strain, pressure in zip(
            self.fingers, contacts, strains, pressures, strict=True
        ):
            signals = own.signals._replace(
                strain=own.signals.strain + strain, finger=own.signals.finger + pressure
            )
            blocks.append(finger.record(own._replace(signals=signals)))
        samples = np.concatenate([block.samples for block in blocks], axis=1)
        return AudioBlock(samples, LIVE_SAMPLE_RATE, blocks[0].start)

    def truth_of(self, finger: int) -> int:
        """Return the `Touch` of a finger at the end of the last block."""
        touch = self.fingers[finger].truth.touch
        return int(touch[-1]) if len(touch) else 0
