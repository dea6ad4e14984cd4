import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable

import numpy as np
import pytest

from tactophone.core.errors import DeviceError
from tactophone.core.types import FloatArray
from tactophone.live.audio.dummy import DummyServer
from tactophone.live.audio.jack import JackClient, disconnect_from_jack

pytestmark = pytest.mark.realtime


class Recorder:
    """Takes what comes in and plays a level."""

    def __init__(self) -> None:
        self.level = 0.0
        self.peaks: list[float] = []

    def __call__(self, inputs: list[FloatArray], outputs: list[FloatArray]) -> None:
        self.peaks.extend(float(np.abs(samples).max()) for samples in inputs)
        for samples in outputs:
            samples[:] = self.level


def eventually(condition: Callable[[], bool]) -> bool:
    for _ in range(500):
        if condition():
            return True
        time.sleep(0.01)
    return False


def test_ports_of_two_clients_carry_sound(jack_server: DummyServer) -> None:
    player, listener = Recorder(), Recorder()
    player.level = 0.5
    source = JackClient(
        "player", player, inputs={}, outputs={"out": ""}, server=jack_server.name
    )
    source.open()
    sink = JackClient(
        "listener",
        listener,
        inputs={"in": "player:out"},
        outputs={},
        server=jack_server.name,
    )
    sink.open()
    assert eventually(lambda: listener.peaks[-1:] == [0.5])
    assert (sink.sample_rate, sink.period, sink.fault) == (48_000, 128, "")
    assert "player:out" in [
        port.name for port in sink.ports() if port.is_output and not port.physical
    ]
    sink.close()
    source.close()


def test_a_killed_server_is_a_fault_and_its_successor_is_joined() -> None:
    server = DummyServer(128)
    server.start()
    recorder = Recorder()
    client = JackClient(
        "robot",
        recorder,
        inputs={"contact": "system:capture_1"},
        outputs={},
        server=server.name,
    )
    client.open()
    assert eventually(lambda: len(recorder.peaks) > 3)
    server.kill()
    assert eventually(lambda: client.fault != "")
    assert "gone" in client.fault
    assert client.losses == 1
    assert client.lost
    client.revive()
    assert client.lost
    assert client.fault != ""
    server.start()
    try:
        calls = len(recorder.peaks)
        assert eventually(lambda: client.revive() or client.fault == "")
        assert not client.lost
        assert eventually(lambda: len(recorder.peaks) > calls)
    finally:
        client.close()
        server.stop()


def test_another_rate_is_a_fault_until_a_server_of_the_first_rate_follows() -> None:
    server = DummyServer(128)
    server.start()
    recorder = Recorder()
    client = JackClient(
        "robot",
        recorder,
        inputs={"contact": "system:capture_1"},
        outputs={},
        server=server.name,
    )
    client.open()
    try:
        for rate, works in ((44_100, False), (48_000, True)):
            server.kill()
            assert eventually(lambda: client.revive() or "gone" in client.fault)
            server.sample_rate = rate
            server.start()
            assert eventually(lambda: client.revive() or "gone" not in client.fault)
            recorder.peaks.clear()
            assert eventually(lambda: len(recorder.peaks) > 0) is works
            client.revive()
            assert (
                client.fault == ""
                if works
                else "44100 Hz now, but 48000 Hz is needed" in client.fault
            )
    finally:
        client.close()
        server.stop()


def test_a_rate_that_changes_in_a_run_is_silence_and_a_fault_until_it_is_back(
    jack_server: DummyServer, monkeypatch: pytest.MonkeyPatch
) -> None:
    """PipeWire changes it; jackd cannot, so that the binding's answer is changed."""
    rate = [48_000]
    monkeypatch.setattr(
        pytest.importorskip("jack").Client, "samplerate", property(lambda _: rate[0])
    )
    recorder = Recorder()
    client = JackClient(
        "robot",
        recorder,
        inputs={"contact": "system:capture_1"},
        outputs={"coil": ""},
        server=jack_server.name,
    )
    client.open()
    try:
        assert eventually(lambda: len(recorder.peaks) > 3)
        rate[0] = 96_000
        assert "runs at 96000 Hz now, but 48000 Hz is needed" in client.fault
        client.revive()
        assert "96000 Hz now" in client.fault
        # The period that was under way may still be heard.
        time.sleep(0.1)
        recorder.peaks.clear()
        time.sleep(0.1)
        assert recorder.peaks == []
        rate[0] = 48_000
        assert client.fault == ""
        assert eventually(lambda: len(recorder.peaks) > 3)
    finally:
        client.close()


def test_a_server_with_another_card_is_a_fault_until_the_first_is_back(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """jackd's ports are called alike with any card; its alias names the card. The dummy
    driver has one alias, so that the binding's answer is changed."""
    server = DummyServer(128)
    server.start()
    recorder = Recorder()
    client = JackClient(
        "operator",
        recorder,
        inputs={"in": "system:capture_1"},
        outputs={"coil": "system:playback_1"},
        server=server.name,
    )
    card = ["alsa_pcm:hw:USB"]
    aliases = property(lambda port: [f"{card[0]}:{port.shortname}"])
    monkeypatch.setattr(pytest.importorskip("jack").Port, "aliases", aliases)
    client.open()
    try:
        for card[0], works in (("alsa_pcm:hw:0", False), ("alsa_pcm:hw:USB", True)):
            server.kill()
            assert eventually(lambda: client.revive() or "gone" in client.fault)
            server.start()
            assert eventually(lambda: client.revive() or "gone" not in client.fault)
            connected = [port.connections for port in client._client.outports]
            assert bool(connected[0]) is works
            wanted = "" if works else "hw:0:playback_1 now, but alsa_pcm:hw:USB"
            assert wanted in client.fault
            assert bool(client.fault) is not works
    finally:
        client.close()
        server.stop()


def test_periods_longer_than_a_command_holds_are_a_fault_while_they_last(
    jack_server: DummyServer,
) -> None:
    """Any program may set their length: `jack_bufsize`, or one that joins PipeWire."""
    recorder = Recorder()
    client = JackClient(
        "operator", recorder, inputs={}, outputs={"coil": ""}, server=jack_server.name
    )
    client.open()
    try:
        for size, words in ((1024, ""), (4096, "4096 samples now, 85 ms"), (64, "")):
            command = ["jack_bufsize", str(size)]
            environment = os.environ | {"JACK_DEFAULT_SERVER": jack_server.name}
            subprocess.run(command, env=environment, check=True, capture_output=True)
            assert eventually(lambda size=size: client.period == size)
            assert words in client.fault
            assert bool(client.fault) is bool(words)
        assert client.process_faults == 0
    finally:
        client.close()


def test_a_port_that_comes_late_is_wired_by_reviving(jack_server: DummyServer) -> None:
    player, listener = Recorder(), Recorder()
    player.level = 0.5
    early = JackClient(
        "player", player, inputs={}, outputs={"out": ""}, server=jack_server.name
    )
    early.open()
    sink = JackClient(
        "listener",
        listener,
        inputs={"in": "player:out"},
        outputs={},
        server=jack_server.name,
    )
    sink.open()
    early.close()
    assert eventually(lambda: sink.revive() or "no JACK port player:out" in sink.fault)
    early.open()
    assert eventually(lambda: sink.revive() or sink.fault == "")
    assert eventually(lambda: listener.peaks[-1:] == [0.5])
    sink.close()
    early.close()


def test_two_wirings_of_one_client_are_both_checked(jack_server: DummyServer) -> None:
    client = JackClient(
        "robot",
        Recorder(),
        inputs={"air": "system:capture_7"},
        outputs={},
        server=jack_server.name,
    )
    with pytest.raises(DeviceError, match="system:capture_7"):
        client.open()
    assert client.period == 0


def test_a_client_leaves_a_server_that_does_not_answer(
    jack_server: DummyServer,
) -> None:
    client = JackClient(
        "robot", Recorder(), inputs={}, outputs={}, server=jack_server.name
    )
    client.open()
    os.kill(jack_server.pid, signal.SIGSTOP)
    try:
        client.close()
    finally:
        os.kill(jack_server.pid, signal.SIGCONT)
    client.open()
    assert client.fault == ""
    client.close()


def test_a_client_whose_sockets_are_shut_down_joins_again(
    jack_server: DummyServer,
) -> None:
    client = JackClient(
        "robot", Recorder(), inputs={}, outputs={"out": ""}, server=jack_server.name
    )
    client.open()
    assert disconnect_from_jack(os.getpid())
    assert eventually(lambda: client.fault != "")
    assert eventually(lambda: client.revive() or client.fault == "")
    client.close()
    assert client.losses == 1


STARVED = """
import sys, threading, time
from tactophone.live.audio.jack import JackClient

def silent(inputs, outputs):
    for samples in outputs:
        samples[:] = 0.0

def compute():
    while True:
        sum(range(200_000))

for _ in range(3):
    threading.Thread(target=compute, daemon=True).start()
for _ in range(3):
    ports = dict(inputs={"in": ""}, outputs={"out": ""})
    client = JackClient("starved", silent, **ports, server=sys.argv[1])
    client.open()
    time.sleep(0.1)
    client.close()
"""


def test_a_client_of_a_starved_interpreter_ends(jack_server: DummyServer) -> None:
    """libjack cancels the thread of its callback; one that waits for the interpreter
    would keep its lock for ever."""
    subprocess.run(
        [sys.executable, "-c", STARVED, jack_server.name], timeout=30, check=True
    )


SIBLINGS = """
from tactophone.live.audio.dummy import DummyServer
from tactophone.live.audio.jack import JackClient
from tests.live.audio.test_jack import Recorder, eventually

server = DummyServer(128)
server.start()
def listener(name):
    inputs = {"in": ""}
    return JackClient(name, Recorder(), inputs=inputs, outputs={}, server=server.name)

clients = [listener("one"), listener("two")]
for client in clients:
    client.open()
server.kill()
server.start()
for client in clients:
    assert eventually(lambda: client.losses == 1)
    assert eventually(lambda: client.revive() or client.fault == "")
for client in clients:
    client.close()
server.stop()
"""


def test_two_clients_of_one_process_outlive_their_server() -> None:
    """libjack closes all clients of a process when the first of them joins a new
    server."""
    subprocess.run([sys.executable, "-c", SIBLINGS], timeout=30, check=True)
