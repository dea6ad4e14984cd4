"""Hapbeat over UDP: ``tactophone receive --actuator hapbeat:ADDRESS``; the vibration
itself, 16 kHz in 16 bits.

The packets are those of the maker's Python SDK 0.3.0 (stream of version 1): header,
begin, data, end.
"""

import socket
import struct

import numpy as np
from numpy.typing import NDArray

from tactophone import LIVE_SAMPLE_RATE
from tactophone.live.audio.actuator import Actuator, ClockedDevice, RenderHand

PORT, RATE = 7700, 16_000
BEGIN, DATA, END = 0x30, 0x31, 0x32


class Stream:
    """A stream of samples to one device."""

    def __init__(self, address: str, port: int = PORT) -> None:
        self._socket = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
        self._to, self._number, self._offset = (address, port), 0, 0
        self._send(BEGIN, struct.pack("<HBBIf", RATE, 1, 0, 0, 1.0))

    def play(self, vibration: NDArray[np.float32]) -> None:
        """Play samples at 48 kHz, -1 to 1."""
        # A third of 48 kHz is enough, as nothing vibrates over 1 kHz.
        third = vibration[: len(vibration) // 3 * 3].reshape(-1, 3).mean(1)
        data = (32767 * np.clip(third, -1, 1)).astype("<i2").tobytes()
        self._send(DATA, struct.pack("<I", self._offset) + data)
        self._offset += len(data)

    def close(self) -> None:
        self._send(END, b"")
        self._socket.close()

    def _send(self, kind: int, payload: bytes) -> None:
        # Magic "HB", version, command, number, length of the payload; little-endian.
        head = HEADER.pack(0x4842, 1, kind, self._number & 0xFFFF, len(payload))
        self._number += 1
        self._socket.sendto(head + payload, self._to)


HEADER = struct.Struct("<HBBHH")


class Hapbeat(ClockedDevice):
    """Plays what ``render`` gives for the first finger; the stream ends with the
    device."""

    def __init__(self, render: RenderHand, stream: Stream, *, fingers: int) -> None:
        def play(inputs: list[np.ndarray], outputs: list[np.ndarray]) -> None:
            render(outputs)
            stream.play(outputs[0])

        super().__init__(play, period=LIVE_SAMPLE_RATE // 100, outputs=fingers)
        self._stream = stream

    def close(self) -> None:
        super().close()
        self._stream.close()


def make(*, render: RenderHand, fingers: int, device: str) -> Actuator:
    """Return the actuator of an entry point ``tactophone.actuators``."""
    return Actuator(Hapbeat(render, Stream(device), fingers=fingers))
