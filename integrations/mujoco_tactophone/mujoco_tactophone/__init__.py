"""A contact microphone for MuJoCo."""

from mujoco_tactophone.microphone import ContactMicrophone

__all__ = ["ContactMicrophone"]
