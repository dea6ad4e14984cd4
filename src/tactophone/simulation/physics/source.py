"""The simulated finger: moves in, two microphones out; a peer of a sound device."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tactophone.simulation.physics.compiled import compiled
from tactophone.simulation.physics.contact import slide
from tactophone.simulation.physics.contact_state import BODY, OVERSAMPLING, STATE, ContactState, Ground, Ringing
from tactophone.simulation.physics.finger import FLEXURE, Finger
from tactophone.simulation.physics.microphones import NORMALS, Microphones
from tactophone.simulation.physics.modes import body_modes, mode_table
from tactophone.simulation.physics.motion import Hand, Move
from tactophone.simulation.physics.scene import Scene
from tactophone.simulation.physics.session_variation import SessionVariation
from tactophone.simulation.physics.surface import SPACING
from tactophone.simulation.physics.track import Material, track
from tactophone.types import AlwaysOpen, AudioBlock

RATE = 48_000
"""Hz; the only rate at which the finger is simulated."""

MOTOR_SPEED = 0.15
"""Metres a second at which the arm's motors are at their loudest."""

HOLD = 0.02
"""Seconds for which a touch outlasts the force: a finger that hops from grain to grain has not left the stone."""

PAD_HEIGHT = 0.7e-6
"""Rms height in m of the pad's own micro-roughness."""


@dataclass(frozen=True, slots=True, eq=False)
class Truth:
    """What truly happened in a block, per sample.

    Parameters
    ----------
    touch
        int8: :class:`~tactophone.types.Touch`; ``NONE`` on the ground, which is neither smooth nor rough.
    thing
        int16: index into the scene's ``placed``; their number on the ground; -1 in the air.
    force
        Of contact, in N.
    x, y
        The finger's place, in m.
    """

    touch: NDArray[np.int8]
    thing: NDArray[np.int16]
    force: NDArray[np.float32]
    x: NDArray[np.float64]
    y: NDArray[np.float64]


class SimulatedFinger(AlwaysOpen):
    """A finger over a scene, as a :class:`~tactophone.types.Source`.

    It renders as fast as it is asked and reads no clock: live, its caller paces it. The same moves and seeds give the
    same samples, to the bit, whatever the block sizes.

    Parameters
    ----------
    scene
        What lies under it.
    moves
        What it shall do, oldest first; more can be given at any time by :meth:`move`.
    setup, seed
        The session, and the seed of all noise.
    duration
        Seconds after which iteration ends; never, if ``None``.
    block_size
        Samples a block of iteration.
    place
        Where it hovers at first, in m.

    Examples
    --------
    >>> from tactophone.simulation import find, single
    >>> finger = SimulatedFinger(single(find("lava stone")), place=(0.02, 0.03))
    >>> finger.move(0.06, 0.03, 1.5)
    >>> block = finger.render(480)
    >>> block.samples.shape, block.sample_rate, finger.truth.touch.shape
    ((480, 2), 48000, (480,))
    """

    def __init__(
        self,
        scene: Scene,
        moves: Iterable[Move] = (),
        *,
        setup: SessionVariation | None = None,
        seed: int | Sequence[int] = 0,
        duration: float | None = None,
        block_size: int = 480,
        place: tuple[float, float] = (0.0, 0.0),
    ) -> None:
        setup = setup or SessionVariation()
        self.scene = scene
        self._finger = setup.finger
        self._end = None if duration is None else round(duration * RATE)
        self._block_size, self._position = block_size, 0
        self._hand = Hand(scene.field, x=place[0], y=place[1], rate=RATE)
        self._hand.wish(moves)
        self._rng = np.random.default_rng(np.random.SeedSequence([0xF1A6, *np.atleast_1d(seed)]))
        self._ground = _ground(scene, setup)
        self._state, self._ringing = _rest(self._ground, setup.finger)
        self._microphones = Microphones(
            setup.electronics, scene.cavity, seed=np.random.SeedSequence([0x3E35, setup.seed]), rate=RATE
        )
        self._labels = np.array([thing.label for thing in scene.things], np.int8)
        self._since_touch = np.array([RATE, -1])
        self.truth = _nothing()

    @property
    def sample_rate(self) -> int:
        """In Hz."""
        return RATE

    @property
    def channels(self) -> int:
        """Contact and air."""
        return 2

    def __iter__(self) -> Iterator[AudioBlock]:
        while self._end is None or self._position < self._end:
            left = self._block_size if self._end is None else self._end - self._position
            yield self.render(min(self._block_size, left))

    def move(self, x: float, y: float, force: float, time: float | None = None) -> None:
        """Wish to be at ``x, y`` (m) pressing with ``force`` (N; negative lifts), at ``time`` (s) or as soon as it can.

        May be called from any thread.
        """
        self._hand.wish([Move(self._position / RATE if time is None else time, x, y, force)])

    def render(self, size: int) -> AudioBlock:
        """Go on for ``size`` samples; what truly happened in them is in ``truth`` afterwards."""
        path = self._hand.follow(size)
        normals = self._rng.standard_normal((size, OVERSAMPLING + NORMALS))
        heard = ContactState(*(np.empty(size) for _ in ContactState._fields))
        noise = np.ascontiguousarray(normals[:, :OVERSAMPLING])
        slide(path.motion, noise, self._ground, self._finger, self._state, self._ringing, heard, float(RATE))
        motor = np.minimum(1.0, np.abs(path.motion.speed) / MOTOR_SPEED)
        samples = self._microphones.convert(heard, motor, np.ascontiguousarray(normals[:, OVERSAMPLING:]))
        thing = np.empty(size, np.int16)
        _touched(heard.force, path.motion.body, thing, self._since_touch, int(HOLD * RATE))
        touch = np.where(thing < 0, np.int8(0), self._labels[thing])
        self.truth = Truth(touch, thing, heard.force.astype(np.float32), path.x, path.y)
        block = AudioBlock(samples, RATE, self._position)
        self._position += size
        return block


def _ground(scene: Scene, setup: SessionVariation) -> Ground:
    """Lay out all that can be touched for the kernel."""
    things = scene.things
    tracks = [track(thing.surface, thing.material, setup.finger.tip_radius) for thing in things]
    modes = [
        body_modes(thing.body, thing.mounting, mass=thing.mass, rng=np.random.default_rng([setup.seed, 7, k]))
        for k, thing in enumerate(things)
    ]
    bodies = np.zeros(len(things), BODY)
    for body, thing, ringing in zip(bodies, things, modes, strict=True):
        _fill(body, thing.material, setup.finger)
        body["modes"] = len(ringing)
    size = max(len(FLEXURE), *map(len, modes))
    return Ground(
        light=np.stack([one.light for one in tracks]),
        heavy=np.stack([one.heavy for one in tracks]),
        friction=np.stack([one.friction for one in tracks]),
        spacing=SPACING,
        bodies=bodies,
        modes=np.stack([mode_table(ringing, size) for ringing in (*modes, FLEXURE)]),
        flexure=len(FLEXURE),
    )


def _fill(body: np.void, material: Material, finger: Finger) -> None:
    # Hertz: F = 4/3 E* sqrt(r) d^1.5 (Johnson 1985, eq. 4.23). Micro-roughness of pad and surface adds in power.
    body["stiffness"] = 4 / 3 * material.stiffness * np.sqrt(material.asperity_radius)
    body["kinetic"], body["static"] = material.kinetic, material.static
    body["stribeck_speed"], body["hiss"] = material.stribeck_speed, material.hiss
    body["micro_speed"] = finger.micro_speed * (np.hypot(material.micro_height, PAD_HEIGHT) / 1e-6) ** 0.8


def _rest(ground: Ground, finger: Finger) -> tuple[NDArray[np.void], Ringing]:
    """The finger hovering, nothing ringing."""
    state = np.zeros(1, STATE)
    state["arm"] = state["pad"] = finger.arm_rest
    return state, Ringing(np.zeros(ground.modes.shape), np.zeros(ground.modes.shape))


def _nothing() -> Truth:
    return Truth(np.empty(0, np.int8), np.empty(0, np.int16), np.empty(0, np.float32), np.empty(0), np.empty(0))


@compiled
def _touched(
    force: NDArray[np.float64], body: NDArray[np.int64], thing: NDArray[np.int16], since: NDArray[np.int64], hold: int
) -> None:
    """What is touched at each sample; ``since`` holds samples since the last force, and what it came from."""
    for i in range(force.size):
        since[0] += 1
        if force[i] > 0.0:
            since[0], since[1] = 0, body[i]
        thing[i] = since[1] if since[0] <= hold else -1
