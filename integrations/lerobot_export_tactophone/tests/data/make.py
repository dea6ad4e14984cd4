"""Writes the data set beside it by LeRobot itself: ``python make.py FOLDER``, with
``pip install lerobot==0.4.4``."""

import sys

import numpy as np
from lerobot.datasets.lerobot_dataset import LeRobotDataset

FPS = 30
FRAMES = 45
JOINTS = ["shoulder", "elbow"]

features = {
    name: {"dtype": "float32", "shape": (2,), "names": JOINTS}
    for name in ("observation.state", "action")
}
features["observation.images.front"] = {
    "dtype": "video",
    "shape": (64, 64, 3),
    "names": ["height", "width", "channels"],
}
dataset = LeRobotDataset.create(
    "local/robot", FPS, features, root=sys.argv[1], robot_type="test"
)
for episode in range(3):
    for frame in range(FRAMES):
        angle = np.array(
            [np.sin((episode * FRAMES + frame) / 10), np.cos(frame / 12)], np.float32
        )
        picture = np.full((64, 64, 3), 40 * episode + frame, np.uint8)
        row = {
            "observation.state": angle,
            "action": angle + np.float32(0.01),
            "observation.images.front": picture,
        }
        dataset.add_frame(row | {"task": "feel the stone"})
    dataset.save_episode()
dataset.finalize()
