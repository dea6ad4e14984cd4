"""Other programs on the same JACK server, with the same impulses: JackTrip, if it is
here (`apt install jacktrip`).

SonoBus is not packaged for Debian 12, and needs a display; aiortc cannot be compared at
these delays, as its sound frames of 20 ms are fixed and its jitter buffer holds four of
them: 102 ms from click to decoded frame, measured apart.
"""

import os
import shutil
import subprocess
import time
from collections.abc import Iterator
from contextlib import contextmanager

import numpy as np

from tactophone.core.errors import DeviceError, TactophoneError
from tactophone.live.audio.dummy import DummyServer
from tactophone.live.audio.jack import JackClient
from tactophone.live.telemetry.layout import MARK, MARKS
from tactophone_lab.measurement.impulses import ImpulseLatency, ImpulsePlayer, analyse

FREE_PORTS = 18_464, 18_465
"""UDP ports of the two ends; JackTrip's own default is 4464."""

_NO_MARKS = np.zeros(0, MARK)


def installed() -> bool:
    """Whether JackTrip is here."""
    return shutil.which("jacktrip") is not None


def jacktrip(period: int, *, queue: int, impulses: int) -> ImpulseLatency:
    """Measure JackTrip in peer-to-peer mode, 16 bits uncompressed and unencrypted, with
    a jitter queue of packets."""
    with DummyServer(period) as server, _ends(server.name, queue):
        player = ImpulsePlayer(impulses)
        sound = {"contact": "near:send_1", "air": "near:send_2"}
        client = JackClient(
            "player",
            player.process,
            inputs={"vibration": "far:receive_1"},
            outputs=sound,
            server=server.name,
        )
        _open(client)
        try:
            while not player.done:
                time.sleep(0.5)
        finally:
            client.close()
    return analyse(player, dict.fromkeys(MARKS, _NO_MARKS), period=period)


@contextmanager
def _ends(server: str, queue: int) -> Iterator[None]:
    near, far = map(str, FREE_PORTS)
    common = ["-q", str(queue), "-n", "2", "-D"]
    environment = os.environ | {
        "JACK_DEFAULT_SERVER": server,
        "JACK_NO_START_SERVER": "1",
    }
    commands = (
        ["jacktrip", "-s", "-J", "far", "-B", far, "-P", near, *common],
        ["jacktrip", "-c", "127.0.0.1", "-J", "near", "-B", near, "-P", far, *common],
    )
    ends = []
    try:
        for command in commands:
            ends.append(
                subprocess.Popen(
                    command,
                    env=environment,
                    stdout=subprocess.DEVNULL,
                    stderr=subprocess.DEVNULL,
                )
            )
            time.sleep(
                1.0
            )  # the second end gives up where the first does not answer yet
        yield
    finally:
        for end in ends:
            end.terminate()
        for end in ends:
            end.wait(5)


def _open(client: JackClient) -> None:
    for _ in range(100):
        try:
            client.open()
            return
        except DeviceError:  # its ports appear once both ends are connected
            time.sleep(0.1)
    raise TactophoneError("JackTrip's ports did not appear within 10 s")
