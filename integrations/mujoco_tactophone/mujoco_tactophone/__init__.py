"""A contact microphone for MuJoCo, and the task StoneBox-v0.

``gymnasium.make("mujoco_tactophone:StoneBox-v0")`` imports this package, and thereby
registers the task: gymnasium 1.x loads no entry points of other packages.
"""

import gymnasium

from mujoco_tactophone.microphone import ContactMicrophone

__all__ = ["ContactMicrophone"]

if "StoneBox-v0" not in gymnasium.registry:
    gymnasium.register(
        "StoneBox-v0", entry_point="mujoco_tactophone.stone_box:StoneBox"
    )
