"""One channel of a device with four, as a DualSense has: bit for bit, and silence on
the others."""

import contextlib
import os
import subprocess
import sys
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

from tactophone.core.types import FloatArray
from tactophone.live.audio.actuator import jack_hand_actuator
from tactophone.live.audio.dummy import DummyServer
from tactophone.live.audio.jack import JackClient
from tactophone.live.audio.jack_binding import jack_module
from tactophone.live.audio.portaudio import PortAudioDevice
from tactophone.live.audio.survey import DUALSENSE_CHANNEL, assess, dualsense_port

from .test_jack import eventually

ALSA = """</usr/share/alsa/alsa.conf>
pcm.dualsense {{
  type file
  slave.pcm {{ type null }}
  file {path}
  format raw
  hint {{ show on description "DualSense Wireless Controller" }}
}}
"""

PLAY = """
import threading
import numpy as np
from tactophone.live.audio.actuator import portaudio_hand_actuator

played, enough = [], threading.Event()
generator = np.random.default_rng(1)

def render(outs):
    (out,) = outs
    out[:] = generator.uniform(-0.5, 0.5, len(out)).astype(np.float32)
    played.append(out.copy())
    if len(played) > 20:
        enough.set()

with portaudio_hand_actuator(render, device="dualsense", channels=[3]) as actuator:
    assert enough.wait(10)
    assert actuator.device.process_faults == 0
np.save({path!r}, np.concatenate(played))
"""


def in_alsa(tmp_path: Path, program: str) -> str:
    """Run a program with a virtual sound card of ALSA's file plug-in as its only
    device."""
    (tmp_path / "asound.conf").write_text(ALSA.format(path=tmp_path / "played.raw"))
    environment = {
        **os.environ,
        "ALSA_CONFIG_PATH": str(tmp_path / "asound.conf"),
        "JACK_NO_START_SERVER": "1",
    }
    command = [sys.executable, "-c", program]
    return subprocess.run(
        command, env=environment, check=True, capture_output=True, text=True, timeout=60
    ).stdout


@pytest.mark.realtime
@pytest.mark.skipif(
    not Path("/usr/share/alsa/alsa.conf").exists(),
    reason="ALSA's configuration is not installed",
)
def test_channel_three_alone_sounds_bit_for_bit(tmp_path: Path) -> None:
    in_alsa(tmp_path, PLAY.format(path=str(tmp_path / "rendered.npy")))
    rendered = np.load(tmp_path / "rendered.npy")
    played = np.fromfile(tmp_path / "played.raw", np.float32).reshape(-1, 4)
    # The device may end in the middle of a period, and is fed silence before the first
    # one.
    start = int(np.flatnonzero(played[:, 2])[0])
    sound = played[start : start + len(rendered), 2]
    assert len(sound) > 1000
    assert np.array_equal(sound, rendered[: len(sound)])
    assert not played[:, [0, 1, 3]].any()


@pytest.mark.realtime
@pytest.mark.skipif(
    not Path("/usr/share/alsa/alsa.conf").exists(),
    reason="ALSA's configuration is not installed",
)
def test_devices_recognises_it_and_prints_what_to_type(tmp_path: Path) -> None:
    program = (
        "from tactophone.cli import main; main(['devices', '--set', "
        "'process.jack_server=tactophone-none'])"
    )
    words = " ".join(in_alsa(tmp_path, program).split())
    assert "a DualSense" in words
    assert "--set output.channel=3" in words
    assert "--set rendering.profile=dualsense" in words


def test_a_wireless_controller_with_two_outputs_is_none() -> None:
    device = PortAudioDevice(
        2, "Wireless Controller: USB Audio (hw:1,0)", "ALSA", 1, 2, 48_000.0, 0.01, 0.01
    )
    assert not any("channel" in setting for setting in assess(device).settings)


@pytest.mark.parametrize(
    ("ports", "chosen"),
    [
        (["DualSense Pro:playback_AUX1", "DualSense Pro:playback_AUX2"], "AUX2"),
        (["DualSense wireless controller (PS5) Analog Surround 4.0:playback_RL"], "RL"),
        (["Speakers:playback_RL"], ""),
    ],
)
def test_its_jack_port_is_the_left_coil(ports: list[str], chosen: str) -> None:
    assert dualsense_port(ports).endswith(chosen)
    assert bool(dualsense_port(ports)) == bool(chosen)


def connections_of(port: str, *, server: str) -> list[str]:
    """Return the ports that a port of a JACK server is connected to."""
    client = jack_module().Client("looker", no_start_server=True, servername=server)
    with contextlib.closing(client):
        return [entry.name for entry in client.get_all_connections(port)]


@pytest.mark.realtime
def test_a_jack_port_by_name_is_connected_alone() -> None:
    played: list[FloatArray] = []
    rendered: list[FloatArray] = []

    def render(outs: Sequence[FloatArray]) -> None:
        (out,) = outs
        out[:] = (
            np.arange(
                len(rendered) * len(out),
                (len(rendered) + 1) * len(out),
                dtype=np.float32,
            )
            / 1e6
        )
        rendered.append(out.copy())

    with (
        DummyServer(128, outputs=4) as server,
        jack_hand_actuator(
            render,
            ports={"vibration": f"system:playback_{DUALSENSE_CHANNEL}"},
            server=server.name,
            name="operator",
        ),
    ):
        wire = {"in": "operator:vibration"}
        listener = JackClient(
            "listener",
            lambda inputs, _: played.append(inputs[0].copy()),
            inputs=wire,
            outputs={},
            server=server.name,
        )
        listener.open()
        ports = {port.name for port in listener.ports()}
        connected = connections_of("operator:vibration", server=server.name)
        # A busy machine loses periods: those that were heard are looked for among those
        # that were rendered.
        assert eventually(
            lambda: (
                len(
                    {block.tobytes() for block in rendered}
                    & {b.tobytes() for b in played}
                )
                > 5
            )
        )
        listener.close()
    assert "system:playback_4" in ports
    assert sorted(connected) == ["listener:in", "system:playback_3"]
