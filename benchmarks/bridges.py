"""How many predictions reach other systems, and how long after they were made, from a live run on this machine.

``python benchmarks/bridges.py [WAY ...]`` runs a loopback with the simulated finger for each way: osc, ros, gloves,
zenoh, foxglove; ``none`` without a bridge, and ``all`` with four. It prints the share of predictions that arrived, the
delay from the moment at which one was made (p50, p95), the live latency (median from microphone to vibration) and the
processor time of the run's two ends; at the end, both with all bridges over those without. Four minutes.
The readers are the libraries of those systems and a plain socket; nothing of the bridges. A glove's message holds
amplitudes alone, so only predictions whose amplitude no other has are looked for.
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
from collections import Counter
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from tactophone.live.telemetry.watcher import Watcher, running

SECONDS = float(os.environ.get("SECONDS_EACH", "10"))
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

    settings = {
        "mode": "peer",
        "scouting": {"multicast": {"enabled": False}},
        "connect": {"endpoints": [f"tcp/127.0.0.1:{port}"], "timeout_ms": -1, "exit_on_failure": False},
        "listen": {"endpoints": []},
    }
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


def read_gloves(arrived: Arrived, port: int) -> None:
    """Take the messages to a MANUS glove: amplitudes of thumb to little finger."""
    from cyclonedds.core import Policy, Qos
    from cyclonedds.domain import DomainParticipant
    from cyclonedds.idl import IdlStruct, types
    from cyclonedds.sub import DataReader
    from cyclonedds.topic import Topic
    from cyclonedds.util import duration

    @dataclass
    class Command(IdlStruct, typename="manus_ros2_msgs::msg::dds_::ManusVibrationCommand_"):
        intensities: types.array[types.float32, 5] = field(default_factory=lambda: [0.0] * 5)

    qos = Qos(Policy.Reliability.Reliable(duration(milliseconds=100)), Policy.History.KeepLast(10))
    domain = DomainParticipant(DOMAIN)
    reader = DataReader(domain, Topic(domain, "rt/manus_glove_0/vibration_cmd", Command, qos))
    while not ended.is_set():
        for message in reader.take(N=10):
            arrived((message.intensities[1],))
        time.sleep(0.0005)


READERS = {
    "osc": read_osc, "ros": read_ros, "gloves": read_gloves, "zenoh": read_zenoh, "foxglove": read_foxglove,
}  # fmt: skip
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


def measure(way: str) -> tuple[float, float]:
    """Return the live latency in s, and the processor time of both ends as a share of a core."""
    with socket.socket() as probe, socket.socket() as other:
        probe.bind(("127.0.0.1", 0))
        other.bind(("127.0.0.1", 0))
        port, page = probe.getsockname()[1], other.getsockname()[1]
    bridges = {"osc": f"osc=127.0.0.1:{port}", "ros": f"ros={DOMAIN}", "zenoh": f"zenoh={DOMAIN}",
               "foxglove": f"foxglove=127.0.0.1:{page}"}  # fmt: skip
    chosen = {"all": list(bridges), "none": [], "gloves": ["ros"]}.get(way, [way])
    options = [word for name in chosen for word in ("--bridge", bridges[name])]
    options += ["--set", "bridges.ros_sinks=manus"] if way == "gloves" else []
    with tempfile.TemporaryDirectory() as folder:
        config = Path(folder, "zenoh.json5")
        listen = {
            "mode": "peer",
            "scouting": {"multicast": {"enabled": False}},
            "listen": {"endpoints": [f"tcp/127.0.0.1:{port}"]},
        }
        config.write_text(json.dumps(listen))
        environment = os.environ | {"CYCLONEDDS_URI": LOOPBACK, "ZENOH_SESSION_CONFIG_URI": str(config)}
        os.environ["CYCLONEDDS_URI"] = LOOPBACK
        command = [sys.executable, "-m", "tactophone", "loopback", "--source", "finger", "--actuator", "none"]
        run = subprocess.Popen(
            [*command, *options], env=environment, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True
        )
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
            return _report(way, ends_of(run.pid), port)
        finally:
            ended.set()
            run.send_signal(signal.SIGINT)
            run.wait(20)


def _report(way: str, watchers: list[Watcher], port: int) -> tuple[float, float]:
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
    latency = operator.gauge("latency_total")
    text = f"{way:9} {len(rows) / SECONDS:6.1f} predictions/s, live {1000 * latency:.2f} ms"
    text += f", both ends {100 * share:.1f} % of a core"
    if way in READERS:
        keys = [
            key((row["amplitude"],) if way == "gloves" else (row["none"], row["smooth"], row["rough"])) for row in rows
        ]
        counts = Counter(keys)
        sought = [
            (found, row["made"])
            for found, row in zip(keys, rows, strict=True)
            if way != "gloves" or (counts[found] == 1 and row["amplitude"] > 0)
        ]
        delays = [1000 * (arrivals[found] - made) for found, made in sought if found in arrivals]
        p50, p95 = np.percentile(delays, (50, 95)) if delays else (np.nan, np.nan)
        text += f", {100 * len(delays) / max(1, len(sought)):.1f} % of {len(sought)} arrived"
        text += f", p50 {p50:.1f} ms, p95 {p95:.1f} ms"
    print(text, flush=True)
    return latency, share


if __name__ == "__main__":
    print("load average when this began:", " ".join(f"{load:.1f}" for load in os.getloadavg()), flush=True)
    found = {way: measure(way) for way in sys.argv[1:] or ["none", *READERS, "all"]}
    if {"none", "all"} <= found.keys():
        latency, share = (with_all / without for with_all, without in zip(found["all"], found["none"], strict=True))
        print(f"all four bridges: live latency x {latency:.2f}, processor time of both ends x {share:.2f}")
