"""How many predictions reach other systems, and how long after they were made, from a live run on this machine.

``python benchmarks/bridges.py [osc] [ros] [zenoh] [foxglove]`` runs a loopback with the simulated finger and prints
for each way, the share of predictions that arrived, the delay from the moment at which one was made (p50, p95), and the
processor time of the run's two ends without and with the bridge. The readers are the libraries of those systems and a
plain socket; nothing of the bridges.
"""

import asyncio
import json
import os
import signal
import socket
import struct
import subprocess
import sys
import tempfile
import threading
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from tactophone.telemetry.watcher import Watcher, running

SECONDS = float(os.environ.get("SECONDS_EACH", "20"))
DOMAIN = 91
LOOPBACK = "<General><Interfaces><NetworkInterface name='lo' multicast='true'/></Interfaces></General>"
Arrived = Callable[[tuple[float, ...]], None]
ended = threading.Event()


def read_osc(arrived: Arrived, port: int) -> None:
    """Parse OSC by hand: address, type tags, big-endian floats."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as listening:
        listening.bind(("127.0.0.1", port))
        listening.settimeout(0.2)
        while not ended.is_set():
            try:
                datagram = listening.recv(1 << 12)
            except TimeoutError:
                continue
            if datagram.startswith(b"/tactophone/index/prediction\0"):
                arrived(struct.unpack(">3f", datagram[-12:]))


def read_ros(arrived: Arrived, port: int) -> None:
    from cyclonedds.core import Policy, Qos
    from cyclonedds.domain import DomainParticipant
    from cyclonedds.idl import IdlStruct, types
    from cyclonedds.sub import DataReader
    from cyclonedds.topic import Topic
    from cyclonedds.util import duration

    @dataclass
    class Time(IdlStruct, typename="builtin_interfaces::msg::dds_::Time_"):
        sec: types.int32 = 0
        nanosec: types.uint32 = 0

    @dataclass
    class Header(IdlStruct, typename="std_msgs::msg::dds_::Header_"):
        stamp: Time = field(default_factory=Time)
        frame_id: str = ""

    @dataclass
    class Prediction(IdlStruct, typename="tactophone_msgs::msg::dds_::Prediction_"):
        header: Header = field(default_factory=Header)
        made: Time = field(default_factory=Time)
        rendered: Time = field(default_factory=Time)
        touch: types.uint8 = 0
        probabilities: types.array[types.float32, 3] = field(default_factory=lambda: [0.0] * 3)
        roughness: types.float32 = 0.0
        level_dbfs: types.float32 = 0.0
        amplitude: types.float32 = 0.0
        frequency: types.float32 = 0.0
        event: str = ""

    qos = Qos(Policy.Reliability.Reliable(duration(milliseconds=100)), Policy.History.KeepLast(10))
    domain = DomainParticipant(DOMAIN)
    reader = DataReader(domain, Topic(domain, "rt/tactophone/index/touch", Prediction, qos))
    while not ended.is_set():
        for message in reader.take(N=10):
            arrived(tuple(message.probabilities))
        time.sleep(0.0005)


def read_zenoh(arrived: Arrived, port: int) -> None:
    import zenoh

    settings = {"mode": "peer", "scouting": {"multicast": {"enabled": False}},
                "connect": {"endpoints": [f"tcp/127.0.0.1:{port}"], "timeout_ms": -1, "exit_on_failure": False},
                "listen": {"endpoints": []}}  # fmt: skip
    with zenoh.open(zenoh.Config.from_json5(json.dumps(settings))) as session:
        # Twelve numbers follow in the body of CDR after header and times: here only those at known places are read.
        def take(sample: "zenoh.Sample") -> None:
            body = sample.payload.to_bytes()
            # Encapsulation 4, stamp 8, length and "index\0" 10, padding 2, two times 16, touch 1, padding 3.
            arrived(struct.unpack_from("<3f", body, 4 + 8 + 10 + 2 + 16 + 1 + 3))

        session.declare_subscriber(f"{DOMAIN}/tactophone/index/touch/**", take)
        ended.wait()


def read_foxglove(arrived: Arrived, port: int) -> None:
    import aiohttp

    async def view() -> None:
        async with (
            aiohttp.ClientSession() as session,
            session.ws_connect(addresses["foxglove"], protocols=["foxglove.websocket.v1"]) as view,
        ):
            async for message in view:
                if ended.is_set():
                    return
                if message.type is aiohttp.WSMsgType.TEXT:
                    channels = json.loads(message.data).get("channels", [])
                    wanted = [each["id"] for each in channels if each["topic"].endswith("/prediction")]
                    subscriptions = [{"id": number, "channelId": number} for number in wanted]
                    if wanted:
                        await view.send_json({"op": "subscribe", "subscriptions": subscriptions})
                else:
                    found = json.loads(message.data[13:])
                    arrived((found["none"], found["smooth"], found["rough"]))

    asyncio.run(view())


READERS = {"osc": read_osc, "ros": read_ros, "zenoh": read_zenoh, "foxglove": read_foxglove}
addresses: dict[str, str] = {}


def processor_time(pids: list[int]) -> float:
    fields = [Path(f"/proc/{pid}/stat").read_text().rpartition(")")[2].split() for pid in pids]
    return sum(int(each[11]) + int(each[12]) for each in fields) / os.sysconf("SC_CLK_TCK")


def ends_of(parent: int) -> list[Watcher]:
    """Return the runs that a process started; others on this machine are left alone."""
    found = [watcher for name in running() if (watcher := Watcher.find(name))]
    return [each for each in found if f"PPid:\t{parent}\n" in Path(f"/proc/{each.pid}/status").read_text()]


def key(values: tuple[float, ...]) -> bytes:
    return np.asarray(values, np.float32).tobytes()


def measure(way: str) -> None:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    bridge = {"osc": f"osc=127.0.0.1:{port}", "ros": f"ros={DOMAIN}", "zenoh": f"zenoh={DOMAIN}",
              "foxglove": f"foxglove=127.0.0.1:{port}"}.get(way)  # fmt: skip
    with tempfile.TemporaryDirectory() as folder:
        config = Path(folder, "zenoh.json5")
        listen = {"mode": "peer", "scouting": {"multicast": {"enabled": False}},
                  "listen": {"endpoints": [f"tcp/127.0.0.1:{port}"]}}  # fmt: skip
        config.write_text(json.dumps(listen))
        environment = os.environ | {"CYCLONEDDS_URI": LOOPBACK, "ZENOH_SESSION_CONFIG_URI": str(config)}
        os.environ["CYCLONEDDS_URI"] = LOOPBACK
        command = [sys.executable, "-m", "tactophone", "loopback", "--source", "finger", "--actuator", "none"]
        run = subprocess.Popen([*command, *(["--bridge", bridge] if bridge else [])], env=environment,
                               stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)  # fmt: skip
        assert run.stdout
        lines: list[str] = []
        threading.Thread(target=lambda: lines.extend(run.stdout or ()), daemon=True).start()
        try:
            until = time.monotonic() + 60
            while time.monotonic() < until and run.poll() is None and len(ends_of(run.pid)) < 2:
                time.sleep(0.2)
            time.sleep(6)
            for line in lines:
                if "ws://" in line:
                    addresses["foxglove"] = "ws://" + line.split("ws://")[1].strip()
            _report(way, ends_of(run.pid), port)
        finally:
            ended.set()
            run.send_signal(signal.SIGINT)
            run.wait(20)


def _report(way: str, watchers: list[Watcher], port: int) -> None:
    operator = next(each for each in watchers if each.state().role == "operator")
    arrivals: dict[bytes, float] = {}
    ended.clear()
    if way in READERS:
        reading = (lambda values: arrivals.setdefault(key(values), time.monotonic()), port)
        threading.Thread(target=READERS[way], args=reading, daemon=True).start()
    time.sleep(3)
    pids = [each.pid for each in watchers]
    used, (_, first) = processor_time(pids), operator.predictions()
    time.sleep(SECONDS)
    share = (processor_time(pids) - used) / SECONDS
    rows, _ = operator.predictions(first)
    time.sleep(0.3)
    delays = [
        1000 * (arrivals[found] - row["made"])
        for row in rows
        if (found := key((row["none"], row["smooth"], row["rough"]))) in arrivals
    ]
    text = f"{way:9} {len(rows) / SECONDS:6.1f} predictions/s, both ends {100 * share:.1f} % of a core"
    if way in READERS:
        p50, p95 = np.percentile(delays, (50, 95)) if delays else (np.nan, np.nan)
        text += f", {100 * len(delays) / len(rows):.1f} % arrived, p50 {p50:.1f} ms, p95 {p95:.1f} ms"
    print(text, flush=True)


if __name__ == "__main__":
    for way in sys.argv[1:] or ["none", *READERS]:
        measure(way)
