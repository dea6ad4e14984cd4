"""Plays the golden run (``tests/data/golden_run``) through the operator's endpoint,
without its encrypted session."""

import base64
import csv
import json
from pathlib import Path
from typing import Any, cast

from tactophone.net.endpoints import OperatorEndpoint
from tactophone.net.link.events import Connected, PacketReceived
from tactophone.net.link.receive import ReceiveSession
from tactophone.net.link.session import Session
from tactophone.signal.haptics.limits import Limits
from tactophone.signal.haptics.profiles import open_profile
from tactophone.signal.pipeline import Pipeline, open_pipeline

FOLDER = Path(__file__).parent / "data" / "golden_run"

COLUMNS = (
    "arrived",
    "start",
    "end",
    "none",
    "smooth",
    "rough",
    "touch",
    "roughness",
    "level_dbfs",
    "event",
    "event_time",
    "time",
    "amplitude",
    "frequency",
)
"""Of ``predictions.csv``; times in s, the last three are the command's and empty where
there was none."""

Row = dict[str, float | str]


class PlainSession:
    """Stands in for the encrypted session: what it receives are the events themselves,
    as JSON."""

    refused = 0
    peer: str | None = None

    def __init__(self) -> None:
        self.polled: list[Any] = []

    def receive(self, datagram: bytes, *, source: object, now: float) -> list[Any]:
        self.peer = "robot"
        return [event_of(json.loads(datagram))]

    def poll(self, now: float) -> list[Any]:
        self.polled, events = [], self.polled
        return events

    def send(self, packet: bytes) -> None:
        pass

    def outgoing(self) -> list[Any]:
        return []


def pipeline() -> Pipeline:
    return open_pipeline(
        "", sample_rate=48_000, channels=2, profile="paper", events=True
    )


def event_of(entry: dict[str, Any]) -> Connected | PacketReceived:
    if entry["kind"] == "connected":
        return Connected("robot", *entry["ssrcs"])
    return PacketReceived(base64.b64decode(entry["content"]), entry["kind"] == "report")


def play() -> list[Row]:
    """Return a row for each prediction, by `COLUMNS`."""
    session = PlainSession()
    endpoint = OperatorEndpoint(ReceiveSession(cast(Session, session)), pipeline())
    controls = json.loads((FOLDER / "controls.json").read_text())
    rows: list[Row] = []
    for line in (FOLDER / "datagrams.jsonl").read_text().splitlines():
        entry = json.loads(line)
        now = entry["time"]
        while controls and controls[0]["time"] <= now:
            change(endpoint.pipeline, controls.pop(0))
        if entry["polled"]:
            session.polled = [event_of(event) for event in entry["events"]]
            steps = endpoint.poll(now)
        else:
            steps = endpoint.receive(
                [(json.dumps(event).encode(), ("", 0)) for event in entry["events"]],
                now=now,
            )
        for _, step in steps:
            for place, prediction in enumerate(step.predictions if step else ()):
                none, smooth, rough = prediction.probabilities
                event = prediction.events[-1] if prediction.events else None
                command = step.commands[place] if step and step.commands else None
                values = (
                    now,
                    prediction.start,
                    prediction.end,
                    none,
                    smooth,
                    rough,
                    prediction.touch.name.lower(),
                    prediction.roughness,
                    prediction.level_dbfs,
                    event.kind if event else "",
                    event.time if event else "",
                    *(
                        (command.time, command.amplitude, command.frequency)
                        if command
                        else ("", "", "")
                    ),
                )
                rows.append(dict(zip(COLUMNS, values, strict=True)))
    return rows


def change(pipeline: Pipeline, control: dict[str, Any]) -> None:
    if "ceiling" in control:
        pipeline.limits = Limits(ceiling=control["ceiling"])
    if "profile" in control:
        pipeline.profile = open_profile(control["profile"])
    if "threshold_dbfs" in control:
        pipeline.detector.threshold.dbfs = control["threshold_dbfs"]


def write(rows: list[Row]) -> None:
    with (FOLDER / "predictions.csv").open("w", newline="") as file:
        writer = csv.DictWriter(file, COLUMNS, lineterminator="\n")
        writer.writeheader()
        rounded = (
            {name: f"{v:.8g}" if isinstance(v, float) else v for name, v in row.items()}
            for row in rows
        )
        writer.writerows(rounded)


def read() -> list[dict[str, str]]:
    with (FOLDER / "predictions.csv").open(newline="") as file:
        return list(csv.DictReader(file))
