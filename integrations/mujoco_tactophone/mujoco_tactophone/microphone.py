"""What two microphones on a fingertip hear of MuJoCo's contacts.

MuJoCo knows the force and the slip of a contact at each step, some 500 times a second,
and nothing of the roughness between. Tactophone's simulated finger knows how a tip
sounds on a surface that it is pressed on and led over. So the physics leads, and the
finger's kernels render: the two channels are contact and air, at 48 kHz, one step
behind.
"""

import math
from dataclasses import replace

import mujoco
import numpy as np

from tactophone import LIVE_SAMPLE_RATE, AudioBlock, ConfigError, DatasetError
from tactophone_lab.simulation.catalogue import SimulatedObject, find
from tactophone_lab.simulation.contact import Motion
from tactophone_lab.simulation.microphone_models import SessionVariation
from tactophone_lab.simulation.modes import Mounting
from tactophone_lab.simulation.motion import LIFT, Path, PlacedObject, Scene, single
from tactophone_lab.simulation.source import SimulatedFinger

Vector = tuple[float, float, float]

STICKS = 1e-3
"""Slip in m/s under which a tip sticks: MuJoCo's soft friction lets a resting contact
creep by about 0.1 mm/s."""

PRESS_CORNER = 9.0
"""Hz up to which the finger's kernels are pressed with the physics' force: that of the
simulated finger's force control. Faster forces are the kernels' own, as the physics
does not know what lies between two of its steps."""

PATH_CORNERS = (28.0, 14.0, 14.0)
"""Hz of the poles by which the tip's place is eased, those of the simulated finger's
hand: what MuJoCo's tip trembles faster, under its servo and its soft friction, would be
a vibration twice, as the kernels have their own."""

HOLD = 0.02
"""Seconds without contact after which the tip has left the geom: MuJoCo's tip hops
between two steps."""

REVERSAL = -0.2
"""Cosine of two directions of slip that makes the way back the same track, as in the
simulated finger."""


class ContactMicrophone:
    """Two microphones on a geom, the tip of a finger.

    Call `step` after each ``mj_step``, and `read` whenever sound is wanted.

    Parameters
    ----------
    model, data
        MuJoCo's.
    geom
        Name of the tip's geom.
    tip
        What touches: ``rubber``, ``pad``, ``plastic`` or ``stylus``.
    mounting
        How the touched objects are held; it decides how they ring.
    seed
        Of all noise, and of the session when the tip is not the pad.

    A touched geom has the surface of the catalogue (``tactophone simulate objects``)
    that a ``<custom><text>`` entry named after the geom holds, or after which its
    material is named; others sound like a floor.

    Raises ``tactophone.ConfigError`` if there is no such geom, or a text names no
    surface.
    """

    def __init__(
        self,
        model: mujoco.MjModel,
        data: mujoco.MjData,
        geom: str,
        tip: str = "pad",
        *,
        mounting: Mounting = Mounting.TABLE,
        seed: int = 0,
    ) -> None:
        self._model, self._data = model, data
        self._geom = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_GEOM, geom)
        if self._geom < 0:
            raise ConfigError(
                f"the model has no geom {geom!r}; name the one that touches"
            )
        found = {
            place: obj
            for place in range(model.ngeom)
            if (obj := surface_of(model, place)) is not None
        }
        self.surfaces = {
            model.geom(place).name or str(place): obj.name
            for place, obj in found.items()
        }
        placed = [
            PlacedObject(
                _own(replace(obj, mounting=mounting), place), 0.1 * place, 0.0, 0.09
            )
            for place, obj in found.items()
        ]
        ground = single(find("smooth competition stone"), mounting).ground
        scene = Scene(
            tuple(placed) or single(find("smooth competition stone")).placed, ground
        )
        self._index = np.full(model.ngeom, len(scene.objects) - 1)
        self._index[list(found)] = range(len(found))
        self._steps: list[tuple[float, float, float, int]] = [
            (0.0, 0.0, LIFT, len(scene.objects) - 1)
        ]
        self._along, self._sign = 0.0, 1.0
        self._direction: Vector | None = None
        self._speed, self._force = np.zeros(6), np.zeros(6)
        self._rendered = 0
        self._since = 0.0
        self.finger = SimulatedFinger(
            scene, session=SessionVariation.of_tip(tip, seed), seed=seed, hand=self
        )
        self.slip = self.force = self._slipped = 0.0
        self._share, *self._shares = (
            1 - math.exp(-2 * math.pi * corner * model.opt.timestep)
            for corner in (PRESS_CORNER, *PATH_CORNERS)
        )
        self._places = [0.0] * len(PATH_CORNERS)
        self._eased, self._press, self._left = LIFT, LIFT, HOLD

    def step(self) -> None:
        """Note the contact of the step that MuJoCo has just taken."""
        step = self._model.opt.timestep
        self.force, self.slip, index = self._contact()
        self._since += step
        self._left = 0.0 if self.force > 0 else self._left + step
        if self.force == 0 and self._left < HOLD:
            self.slip = self._slipped
        self._slipped = self.slip
        self._along += self._sign * self.slip * step
        self._eased += self._share * (
            (self.force if self._left < HOLD else LIFT) - self._eased
        )
        self._press += self._share * (self._eased - self._press)
        place, before = self._along, self._places[-1]
        for pole, share in enumerate(self._shares):
            self._places[pole] += share * (place - self._places[pole])
            place = self._places[pole]
        self._steps.append((place, (place - before) / step, self._press, index))

    def read(self) -> AudioBlock:
        """Return the sound of all steps since the last call, two channels at 48 kHz."""
        size = round(self._since * LIVE_SAMPLE_RATE) - self._rendered
        block = self.finger.render(size)
        self._rendered += size
        return block

    def follow(self, size: int) -> Path:
        """Return the path of the noted steps, for `SimulatedFinger`."""
        steps, self._steps = self._steps, self._steps[-1:]
        along, speed, press, index = (
            np.array(column) for column in zip(*steps, strict=True)
        )
        places = (
            np.linspace(0, len(steps) - 1, size, endpoint=False)
            + (len(steps) - 1) / size
        )
        known = np.arange(len(steps))
        position = np.interp(places, known, along)
        body = index[np.minimum(np.ceil(places).astype(int), len(steps) - 1)].astype(
            np.int64
        )
        motion = Motion(
            position,
            np.interp(places, known, speed),
            np.interp(places, known, press),
            body,
            np.zeros(size),
        )
        return Path(position, np.zeros(size), motion)

    def _contact(self) -> tuple[float, float, int]:
        """Return force (N), slip (m/s) and what is touched, of all contacts of the
        tip."""
        index = self._steps[-1][3]
        if not self._data.ncon:
            self._direction = None
            return 0.0, 0.0, index
        total, slip, strongest = 0.0, (0.0, 0.0, 0.0), 0.0
        contacts = self._data.contact
        for number, (first, second) in enumerate(contacts.geom.tolist()):
            if self._geom not in (first, second):
                continue
            mujoco.mj_contactForce(self._model, self._data, number, self._force)
            normal = float(self._force[0])
            if normal <= 0:
                continue
            other = second if first == self._geom else first
            moved = self._slip(
                contacts.pos[number].tolist(),
                contacts.frame[number, :3].tolist(),
                other,
            )
            total += normal
            slip = (
                slip[0] + normal * moved[0],
                slip[1] + normal * moved[1],
                slip[2] + normal * moved[2],
            )
            if normal > strongest:
                strongest, index = normal, int(self._index[other])
        speed = (
            math.sqrt(slip[0] ** 2 + slip[1] ** 2 + slip[2] ** 2) / total
            if total > 0
            else 0.0
        )
        if total <= 0 or speed < STICKS:
            self._direction = None if total <= 0 else self._direction
            return total, 0.0, index
        x, y, z = (part / (speed * total) for part in slip)
        if (
            self._direction
            and x * self._direction[0] + y * self._direction[1] + z * self._direction[2]
            < REVERSAL
        ):
            self._sign = -self._sign
        self._direction = (x, y, z)
        return total, speed, index

    def _slip(self, at: list[float], normal: list[float], other: int) -> Vector:
        """Return the speed of the tip over the other geom at a place, in the plane of
        this normal."""
        ours, theirs = self._speed_at(self._geom, at), self._speed_at(other, at)
        x, y, z = ours[0] - theirs[0], ours[1] - theirs[1], ours[2] - theirs[2]
        along = x * normal[0] + y * normal[1] + z * normal[2]
        return x - along * normal[0], y - along * normal[1], z - along * normal[2]

    def _speed_at(self, geom: int, at: list[float]) -> Vector:
        if self._model.geom_bodyid[geom] == 0:  # the world stands still
            return 0.0, 0.0, 0.0
        mujoco.mj_objectVelocity(
            self._model, self._data, mujoco.mjtObj.mjOBJ_GEOM, geom, self._speed, 0
        )
        p, q, r, x, y, z = self._speed.tolist()
        a, b, c = (
            here - there
            for here, there in zip(at, self._data.geom_xpos[geom].tolist(), strict=True)
        )
        return x + q * c - r * b, y + r * a - p * c, z + p * b - q * a


def surface_of(model: mujoco.MjModel, geom: int) -> SimulatedObject | None:
    """Return the catalogue's object of a geom, by its text or material; ``None`` where
    neither names one."""
    name = model.geom(geom).name
    text = mujoco.mj_name2id(model, mujoco.mjtObj.mjOBJ_TEXT, name) if name else -1
    if text >= 0:
        start, size = model.text_adr[text], model.text_size[text]
        words = bytes(model.text_data[start : start + size]).rstrip(b"\0").decode()
        try:
            return find(words)
        except DatasetError as error:
            raise ConfigError(f"the text {name!r} of the model: {error}") from error
    if (material := int(model.geom_matid[geom])) < 0:
        return None
    try:
        return find(model.mat(material).name)
    except DatasetError:
        return None


def _own(obj: SimulatedObject, place: int) -> SimulatedObject:
    """Give the object of a geom a profile of its own."""
    return replace(
        obj, surface=replace(obj.surface, seed=obj.surface.seed + 1000 * (place % 7))
    )
