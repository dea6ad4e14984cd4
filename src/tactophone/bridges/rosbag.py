"""A run as a ROS 2 bag (rosbag2, MCAP storage), without a ROS installation."""

from collections.abc import Sequence
from functools import partial
from pathlib import Path
from typing import Any, Self

import numpy as np

from tactophone.errors import ConfigError
from tactophone.types import LIVE_SAMPLE_RATE, PipelineStep, Touch

_FURTHER = {
    "audio_common_msgs/msg/AudioData": "uint8[] data",
    "audio_common_msgs/msg/AudioDataStamped": "std_msgs/Header header\naudio_common_msgs/AudioData audio",
    "audio_common_msgs/msg/AudioInfo": (
        "uint8 channels\nuint32 sample_rate\nstring sample_format\nuint32 bitrate\nstring coding_format"
    ),
    "manus_ros2_msgs/msg/ManusVibrationCommand": "float32[5] intensities",
    "haptx_interfaces/msg/TactorGroupState": "string[] tactor_group\nfloat64[] inflation",
}
"""Types that are not among those of ROS itself."""

_TOPICS = {
    "prediction": "std_msgs/msg/Float32MultiArray",
    "vibration": "std_msgs/msg/Float32MultiArray",
    "roughness": "std_msgs/msg/Float32",
    "contact_dbfs": "std_msgs/msg/Float32",
    "audio": "audio_common_msgs/msg/AudioDataStamped",
    "audio_info": "audio_common_msgs/msg/AudioInfo",
}


class RosBag:
    """Writes steps with the topics of the ROS bridge; a context manager.

    ``epoch`` is in seconds since 1970, at the beginning of the steps' time. Raises `ConfigError` if the folder exists.
    """

    def __init__(self, folder: Path, *, epoch: float, fingers: Sequence[str] = ("index",)) -> None:
        from rosbags.rosbag2 import StoragePlugin, Writer

        if folder.exists():
            raise ConfigError(f"--to-rosbag {folder}: exists already; name a new folder")
        self._store = open_type_store()
        self._writer = Writer(folder, version=9, storage_plugin=StoragePlugin.MCAP)
        self._epoch, self._fingers = epoch, fingers

    def __enter__(self) -> Self:
        self._writer.open()
        self._connections = {
            (finger, suffix): self._writer.add_connection(f"/tactophone/{name}/{suffix}", kind, typestore=self._store)
            for finger, name in enumerate(self._fingers)
            for suffix, kind in _TOPICS.items()
        }
        info = self._type("audio_common_msgs/msg/AudioInfo")(2, LIVE_SAMPLE_RATE, "S16LE", 0, "wave")
        for finger in range(len(self._fingers)):
            self._write(finger, "audio_info", 0.0, info)
        return self

    def __exit__(self, *_: object) -> None:
        self._writer.close()

    def write(self, step: PipelineStep) -> None:
        """Add the sound, the predictions and the commands of a step."""
        write = partial(self._write, step.finger)
        if step.block.size:
            write("audio", step.block.time, self._audio(step))
        for number, prediction in enumerate(step.predictions):
            write("prediction", prediction.end, self._numbers(prediction.probabilities))
            roughness = prediction.roughness if prediction.touch is not Touch.NONE else 0.0
            write("roughness", prediction.end, self._type("std_msgs/msg/Float32")(roughness))
            level = max(prediction.level_dbfs, -200.0)
            write("contact_dbfs", prediction.end, self._type("std_msgs/msg/Float32")(level))
            if step.commands:
                command = step.commands[number]
                write("vibration", command.time, self._numbers((command.amplitude, command.frequency)))

    def _audio(self, step: PipelineStep) -> Any:
        samples = step.block.samples
        stereo = samples if samples.shape[1] == 2 else np.repeat(samples, 2, axis=1)
        data = (np.clip(stereo, -1, 1) * 32_767).astype("<i2").view(np.uint8).ravel()
        seconds = self._epoch + step.block.time
        stamp = self._type("builtin_interfaces/msg/Time")(int(seconds), int(seconds % 1 * 1e9))
        header = self._type("std_msgs/msg/Header")(stamp, "fingertip")
        audio = self._type("audio_common_msgs/msg/AudioData")(data)
        return self._type("audio_common_msgs/msg/AudioDataStamped")(header, audio)

    def _numbers(self, values: tuple[float, ...]) -> Any:
        layout = self._type("std_msgs/msg/MultiArrayLayout")([], 0)
        return self._type("std_msgs/msg/Float32MultiArray")(layout, np.array(values, np.float32))

    def _type(self, name: str) -> Any:
        return self._store.types[name]

    def _write(self, finger: int, suffix: str, time: float, message: Any) -> None:
        data = self._store.serialize_cdr(message, _TOPICS[suffix])
        self._writer.write(self._connections[finger, suffix], round((self._epoch + time) * 1e9), data)


def open_type_store() -> Any:
    """Return the types of all messages here, with their serialization and RIHS01 hashes."""
    from rosbags.typesys import Stores, get_types_from_msg, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    for name, text in _FURTHER.items():
        store.register(get_types_from_msg(text, name))
    return store
