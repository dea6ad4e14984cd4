import json
import shutil
import socket
import subprocess
import threading
from http.server import BaseHTTPRequestHandler, HTTPServer
from pathlib import Path

import numpy as np
import pytest
from devices_tactophone import bhaptics, senseglove
from devices_tactophone.hapbeat import Hapbeat, Stream

from tactophone import HapticCommand


def test_bhaptics_gets_the_levels_of_its_motors() -> None:
    bodies = []

    class Stub(BaseHTTPRequestHandler):
        def do_POST(self) -> None:
            bodies.append(
                (
                    self.path,
                    json.loads(self.rfile.read(int(self.headers["Content-Length"]))),
                )
            )
            self.send_response(200)
            self.end_headers()

        def log_message(self, *_: object) -> None: ...

    server = HTTPServer(("127.0.0.1", 0), Stub)
    thread = threading.Thread(target=server.handle_request)
    thread.start()
    levels = {"index": 0.5, "thumb": 7.0, "palm": 1.0}
    bhaptics.play(
        f"http://127.0.0.1:{server.server_port}",
        levels,
        device_type=8,
        motors={"thumb": 0, "index": 1},
    )
    thread.join()
    server.server_close()
    ((path, body),) = bodies
    assert path == "/haptic/dot"
    assert body["motors"] == [
        {"index": 1, "intensity": 50},
        {"index": 0, "intensity": 100},
    ]
    assert body["duration"] <= 100


def packets() -> list[bytes]:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as receiver:
        receiver.bind(("127.0.0.1", 0))
        receiver.settimeout(2)
        stream = Stream("127.0.0.1", receiver.getsockname()[1])
        stream.play(np.full(480, 0.5, np.float32))
        stream.play(np.zeros(480, np.float32))
        stream.close()
        return [receiver.recv(2048) for _ in range(4)]


def test_hapbeat_gets_a_stream_of_samples() -> None:
    begin, first, second, end = packets()
    assert {packet[:2] for packet in (begin, first, second, end)} == {b"BH"}
    assert [packet[3] for packet in (begin, first, second, end)] == [
        0x30,
        0x31,
        0x31,
        0x32,
    ]
    assert np.frombuffer(first[12:], "<i2").tolist() == [16383] * 160
    assert int.from_bytes(second[8:12], "little") == 320


def test_the_stream_ends_with_the_run() -> None:
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as receiver:
        receiver.bind(("127.0.0.1", 0))
        receiver.settimeout(2)
        device = Hapbeat(
            lambda outputs: None,
            Stream("127.0.0.1", receiver.getsockname()[1]),
            fingers=1,
        )
        device.open()
        kinds = [receiver.recv(2048)[3] for _ in range(3)]
        device.close()
        while kinds[-1] == 0x31:
            kinds.append(receiver.recv(2048)[3])
    assert (kinds[0], kinds[1], kinds[-1]) == (0x30, 0x31, 0x32)


def test_the_makers_own_sdk_writes_the_same_packets() -> None:
    protocol = pytest.importorskip("hapbeat.protocol")
    begin, first, _, end = packets()
    assert begin == protocol.build_stream_begin(0)
    assert first == protocol.build_stream_data(1, 0, first[12:])
    assert end == protocol.build_stream_end(3)


def test_nova_2_gets_amplitude_and_frequency_as_custom_waveforms(
    tmp_path: Path,
) -> None:
    if not shutil.which("g++"):
        pytest.skip("no g++ here")
    stub, program = Path(__file__).parent / "stub", tmp_path / "nova2"
    source = Path(senseglove.__file__).with_name("nova2.cpp")
    subprocess.run(
        ["g++", "-std=c++17", "-Wall", "-Werror", source, "-I", stub, "-o", program],
        check=True,
    )
    commands = {
        "thumb": (7.0, 60.0),
        "index": (0.5, 900.0),
        "palm": (1.0, 60.0),
        "middle": (0.0, 60.0),
    }
    lines = senseglove.lines(
        {name: HapticCommand(*each, 0.0) for name, each in commands.items()}
    )
    done = subprocess.run(
        [program, "right"],
        input="\n".join(lines),
        capture_output=True,
        text=True,
        check=True,
    )
    assert done.stdout.split("\n") == ["1 1 1 0.1 60", "1 2 0.5 0.1 500", "stop 1", ""]
