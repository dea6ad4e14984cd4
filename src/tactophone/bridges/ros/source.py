"""Microphones on a ROS 2 topic as a source: ``audio_common_msgs/AudioDataStamped`` with its latched ``AudioInfo``."""

import time
from collections import Counter
from collections.abc import Iterator
from typing import Any, Self

import numpy as np
from cyclonedds.util import duration

from tactophone.bridges.ros import messages
from tactophone.bridges.ros.dds import DdsTransport, default_domain
from tactophone.errors import ConfigError
from tactophone.types import AlwaysOpen, AudioBlock

INFO_TIMEOUT = 10.0
"""Seconds to wait for the topic's AudioInfo: DDS finds its participants within a few."""

WAIT = 0.02
"""Seconds without sound after which an empty block is returned, so that the reader of the source can end."""

LOWEST_RATE, HIGHEST_RATE = 2_000, 192_000

_SAMPLE = np.dtype("<i2")


class RosSource(AlwaysOpen):
    """A `tactophone.types.Source` of 16-bit samples on a topic such as ``/audio``, with its format on ``/audio_info``.

    Attributes
    ----------
    faults
        ``odd size``: messages that hold no whole samples, which are dropped.

    Raises
    ------
    ConfigError
        If nothing is published there, or in another format.
    """

    def __init__(self, topic: str, *, domain: int | None = None) -> None:
        self.faults: Counter[str] = Counter()
        self._topic = topic
        dds, name = DdsTransport(default_domain() if domain is None else domain), topic.lstrip("/")
        info = dds.reader(f"{name}_info", messages.AudioInfo, latched=True)
        self._reader = dds.reader(name, messages.AudioDataStamped)
        self.sample_rate, self.channels = self._format(info)

    def __enter__(self) -> Self:
        return self

    def __iter__(self) -> Iterator[AudioBlock]:
        start = 0
        while True:
            found = list(self._reader.take_iter(timeout=duration(seconds=WAIT)))
            for message in found:
                samples = self._samples(message)
                yield AudioBlock(samples, self.sample_rate, start)
                start += len(samples)
            if not found:
                yield AudioBlock(np.zeros((0, self.channels), np.float32), self.sample_rate, start)

    def _samples(self, message: Any) -> np.ndarray[Any, np.dtype[np.float32]]:
        data = bytes(message.audio.data)
        if len(data) % (_SAMPLE.itemsize * self.channels):
            self.faults["odd size"] += 1
            data = b""
        samples = np.frombuffer(data, _SAMPLE).reshape(-1, self.channels)
        return (samples / np.float32(32_768)).astype(np.float32)

    def _format(self, reader: Any) -> tuple[int, int]:
        until = time.monotonic() + INFO_TIMEOUT
        while time.monotonic() < until:
            for info in reader.take(N=1):
                return self._checked(info)
            time.sleep(WAIT)
        raise ConfigError(
            f"--source ros:{self._topic}: nothing on {self._topic}_info within {INFO_TIMEOUT:g} s: start the node, or "
            "check ROS_DOMAIN_ID"
        )

    def _checked(self, info: Any) -> tuple[int, int]:
        rate, channels, kind = info.sample_rate, info.channels, (info.coding_format, info.sample_format)
        if kind != ("wave", "S16LE") or channels not in (1, 2) or not LOWEST_RATE <= rate <= HIGHEST_RATE:
            raise ConfigError(
                f"--source ros:{self._topic}: {info.coding_format!r} {info.sample_format!r} of {channels} channels at "
                f"{rate} Hz, but 'wave' 'S16LE' of 1 or 2 channels at {LOWEST_RATE} Hz or more is needed"
            )
        return int(rate), int(channels)
