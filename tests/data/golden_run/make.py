"""Writes the golden run beside this file: five seconds of a simulated finger over a
busy Wi-Fi, in virtual time.

``datagrams.jsonl`` holds what the operator's session reported (RTP and RTCP packets,
decrypted), each with its time in s; ``controls.json`` what somebody changed meanwhile;
``predictions.csv`` what came of it. The test needs nothing but these files. Run this by
hand only when the behaviour is meant to change: ``make golden``.
"""

import base64
import json

from benchmarks.virtual_link import VirtualLink, paired_sessions
from tactophone.core.types import AudioBlock
from tactophone.net.endpoints import OperatorEndpoint, RobotEndpoint
from tactophone.net.impairment import ImpairedLink, NetworkProfile
from tactophone.net.link.codec import Codec
from tactophone.net.link.events import Connected, PacketReceived
from tactophone_lab.simulation.demonstration import demonstration
from tests import golden

START, END = 3.0, 8.0
"""The part of the demonstration that is sent, in s: most of its smooth stone, and of
its rough one."""
CONTROLS = [
    {"time": 2.0, "ceiling": 0.2},
    {"time": 3.0, "ceiling": 0.5},
    {"time": 4.2, "profile": "dualsense"},
    {"time": 4.5, "threshold_dbfs": -45.0},
    {"time": 4.7, "profile": "paper"},
]


def record() -> list[dict[str, object]]:
    """Run both ends in virtual time and return what the operator's session reported."""
    entries: list[dict[str, object]] = []
    robot, operator = paired_sessions(Codec("opus", packet_size=240))

    def tap(now: float, events: list[object], polled: bool) -> None:
        together = []
        for event in events:
            if isinstance(event, PacketReceived):
                content = base64.b64encode(event.packet).decode()
                together.append(
                    {"kind": "report" if event.report else "packet", "content": content}
                )
            elif isinstance(event, Connected):
                together.append(
                    {
                        "kind": "connected",
                        "ssrcs": [event.local_ssrc, event.remote_ssrc],
                    }
                )
        entries.append({"time": round(now, 5), "polled": polled, "events": together})

    operator.tap = tap
    link = VirtualLink(robot, OperatorEndpoint(operator, golden.pipeline()))
    begun = link.connect(0.0)
    link.to_operator = ImpairedLink(
        NetworkProfile(
            loss=0.02,
            burst=2,
            delay=0.002,
            jitter=0.002,
            duplicates=0.01,
            overtaking=True,
            stall=0.05,
            stall_interval=3.0,
        ),
        seed=7,
    )
    sender = RobotEndpoint(robot)
    with demonstration(3) as finger:
        for block in finger:
            if block.end > END * block.sample_rate:
                break
            for at in range(0, block.size, 120):
                start = block.start + at - round(START * block.sample_rate)
                if start < 0:
                    continue
                part = AudioBlock(
                    block.samples[at : at + 120], block.sample_rate, start
                )
                sender.push(part)
                link.carry(round(begun + part.end / part.sample_rate, 5))
    return entries


if __name__ == "__main__":
    (golden.FOLDER / "datagrams.jsonl").write_text(
        "".join(json.dumps(entry) + "\n" for entry in record())
    )
    (golden.FOLDER / "controls.json").write_text(json.dumps(CONTROLS, indent=1) + "\n")
    golden.write(golden.play())
