"""A finger on three slides over stones: the model of the tests, of the example and of
StoneBox."""

from collections.abc import Sequence

import mujoco
import numpy as np

PITCH, WIDTH = 0.11, 0.085
"""Metres from stone to stone, and of a stone's top."""

STEP = 0.002

_ACTUATED = """
<mujoco model="finger">
  <option timestep="{step}" integrator="implicitfast" cone="elliptic"/>
  <custom>{texts}</custom>
  <worldbody>
    <light pos="0.25 -0.4 0.6" dir="-0.1 0.5 -0.8"/>
    <geom name="mat" type="plane" pos="0.2 0 -0.03" size="0.5 0.2 0.01"
      rgba="0.25 0.3 0.25 1"/>
    {stones}
    <body name="finger" pos="0 0 0.012" gravcomp="1">
      <joint name="x" type="slide" axis="1 0 0" damping="1"/>
      <joint name="y" type="slide" axis="0 1 0" damping="1"/>
      <joint name="z" type="slide" axis="0 0 1" damping="12"/>
      <geom name="link" type="capsule" fromto="0 0 0.008 0 0 0.06" size="0.007"
        mass="0.03" contype="0" conaffinity="0" rgba="0.8 0.8 0.85 1"/>
      <geom name="tip" type="sphere" size="0.008" mass="0.006" solref="0.02 1"
        friction="0.4 0.005 0.0001" rgba="0.9 0.5 0.2 1"/>
    </body>
  </worldbody>
  <actuator>
    <position name="x" joint="x" kp="1500" dampratio="1"/>
    <position name="y" joint="y" kp="1500" dampratio="1"/>
    <motor name="press" joint="z" gear="-1"/>
  </actuator>
</mujoco>
"""


def stones_model(names: Sequence[str], width: float = WIDTH) -> mujoco.MjModel:
    """Return a model of a finger over a row of stones of these names of the catalogue,
    ``width`` m wide."""
    texts = "".join(
        f'<text name="stone{k}" data="{name}"/>' for k, name in enumerate(names)
    )
    stones = "".join(
        f'<geom name="stone{k}" type="box" pos="{k * PITCH} 0 -0.01" '
        f'size="{width / 2} 0.035 0.01" '
        f'rgba="0.55 0.55 0.6 1"/>'
        for k in range(len(names))
    )
    return mujoco.MjModel.from_xml_string(
        _ACTUATED.format(step=STEP, texts=texts, stones=stones)
    )


def pressed(force: float, height: float) -> float:
    """Return the motor's force in N that presses with ``force``, or lifts where it is
    not positive."""
    return force if force > 0 else 60.0 * (height - 0.003)


def stroke(
    time: float, *, centre: float = 0.0, amplitude: float = 0.02, period: float = 1.2
) -> float:
    """Return the place in m of a finger that strokes to and fro around ``centre``."""
    return centre + amplitude * float(np.sin(2 * np.pi * time / period))
