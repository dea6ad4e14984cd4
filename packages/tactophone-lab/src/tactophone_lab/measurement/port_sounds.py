"""Sound for the microphone ports of a running system, in place of microphones.

An idle port delivers exact zeros, and equal sound at both ports looks like a mixer that
copies one microphone to both. Neither is what users run: the encoder, the contact gate
and the check of the microphones then have almost nothing to do, or report a fault. So
every port gets background noise of its own, and a touch sounds different at the contact
and the air microphone.
"""

from collections.abc import Iterator, Sequence
from contextlib import closing, contextmanager
from typing import Literal, TypeAlias, get_args

import numpy as np
from numpy.typing import NDArray

from tactophone.core.types import LIVE_SAMPLE_RATE, FloatArray
from tactophone.live.audio.jack import JackClient

PortSound: TypeAlias = Literal["silence", "air", "strokes"]
"""What the ports carry: nothing at all, the background noise of microphones, or strokes
over it."""

PORT_SOUNDS: tuple[PortSound, ...] = get_args(PortSound)

BACKGROUND = 5e-4
"""RMS of the noise of a microphone at rest, of full scale: -66 dBFS, as measured on
simulated fingers. It opens no gate."""

STROKE_STRENGTH = 0.1
"""Highest RMS of a stroke at the contact microphone."""

STROKE_PERIOD = 2.0
"""Seconds from the middle of one stroke to the next; contact lasts half of it."""

AIR_SHARE = 0.3
"""Amplitude at the air microphone, of that at the contact microphone."""

LOOP = 4.0
"""Seconds after which the sound repeats: two strokes."""

_STAGGER = 4_801
"""Samples by which the noise of one port is behind that of the one before: a tenth of a
second, so that no two are alike."""


def background(seed: int = 0) -> FloatArray:
    """Return `LOOP` seconds of a microphone's noise."""
    size = round(LOOP * LIVE_SAMPLE_RATE)
    noise = np.random.default_rng([0xBAC6, seed]).standard_normal(size)
    return (BACKGROUND * noise).astype(np.float32)


def strokes(ports: int) -> FloatArray:
    """Return `LOOP` seconds of strokes of all fingers at once, ``(ports, samples)``:
    contact and air of each finger in turn."""
    size = round(LOOP * LIVE_SAMPLE_RATE)
    times = np.arange(size) / LIVE_SAMPLE_RATE
    swell = np.maximum(0.0, np.sin(2 * np.pi * times / STROKE_PERIOD))
    shares = np.tile([1.0, AIR_SHARE], ports // 2)[:, None]
    noise = np.random.default_rng(0).standard_normal((ports, size))
    return ((BACKGROUND + STROKE_STRENGTH * shares * swell) * noise).astype(np.float32)


class PortPlayer:
    """Plays a sound to all ports, over and over; ``process`` is for a JACK client and
    allocates nothing."""

    def __init__(self, sound: PortSound, ports: int) -> None:
        size = round(LOOP * LIVE_SAMPLE_RATE)
        if sound == "strokes":
            self._sound = strokes(ports)
        elif sound == "air":
            noise = background()
            self._sound = np.stack(
                [np.roll(noise, port * _STAGGER) for port in range(ports)]
            )
        else:
            self._sound = np.zeros((ports, size), np.float32)
        self._position = 0

    def process(self, inputs: list[FloatArray], outputs: list[FloatArray]) -> None:
        size = len(outputs[0])
        if self._position + size > self._sound.shape[1]:
            self._position = 0
        start = self._position
        for port, output in enumerate(outputs):
            output[:] = self._sound[port, start : start + size]
        self._position = start + size


@contextmanager
def playing(
    sound: PortSound, ports: Sequence[str], *, robot: str, server: str
) -> Iterator[JackClient]:
    """Play a sound to ports of the robot's JACK client meanwhile; ``revive`` the client
    that is yielded to connect it to a robot that has joined the server again."""
    player = PortPlayer(sound, len(ports))
    client = JackClient(
        f"tactophone-{sound}",
        player.process,
        inputs={},
        outputs={port: f"{robot}:{port}" for port in ports},
        server=server,
    )
    with closing(client):
        client.open()
        yield client


class Background:
    """The noise of the microphones behind other sound, added in place."""

    def __init__(self) -> None:
        noise = background()
        # Twice, so that a period at any place is one stretch.
        self._noise: NDArray[np.float32] = np.concatenate([noise, noise])
        self._size = len(noise)

    def add(self, output: FloatArray, port: int, position: int) -> None:
        start = (position + port * _STAGGER) % self._size
        output += self._noise[start : start + len(output)]
