"""``tactophone latency``: impulses through the running system, and the latency budget
stage by stage."""

import argparse
from collections.abc import Iterator
from contextlib import ExitStack
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from tactophone.cli import options, output
from tactophone.cli.options import Within
from tactophone.core.settings import Settings
from tactophone.core.types import LIVE_SAMPLE_RATE

if TYPE_CHECKING:  # their imports take a second, which would slow down --help
    from tactophone.signal.perception.model_file import ModelCard
    from tactophone_lab.measurement.delays import DecisionDelays
    from tactophone_lab.measurement.impulses import ImpulseLatency

EXAMPLES = (
    "tactophone latency --dummy",
    "tactophone latency --dummy --codec pcm16 --packet-duration 0.0025 --impulses 400",
    "tactophone latency --impulse-port system:playback_2 --vibration-port "
    "system:capture_3 --json",
)

PERCENTILES = (50, 95, 99)
"""Percentiles of the delays that the table shows."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    options.add_settings(parser, "latency")
    add = parser.add_argument
    add(
        "--impulses",
        type=Within(int, 10, 2000),
        default=100,
        metavar="N",
        help="impulses to play, %(type)s, about 4 a second",
    )
    add(
        "--dummy",
        action="store_true",
        help="start a JACK server without a sound card for this",
    )
    add(
        "--period",
        type=Within(int, 32, 1024, unit="samples"),
        default=128,
        metavar="N",
        help="period of that server, %(type)s",
    )
    add(
        "--impulse-port",
        default="",
        metavar="PORT",
        help="JACK port of a loudspeaker or cable to the microphones",
    )
    add(
        "--vibration-port",
        default="",
        metavar="PORT",
        help="JACK port of a sensor or cable on the actuator",
    )
    add(
        "--no-decisions",
        action="store_true",
        help="do not measure the decision delay (simulated, 10 s)",
    )
    options.add_json(parser, "print all figures for a program")


def run(args: argparse.Namespace) -> int:
    from tactophone.live.audio.dummy import DummyServer
    from tactophone.signal.perception.model_file import read_model
    from tactophone.signal.perception.models import default_model, model_path
    from tactophone.signal.pipeline import open_pipeline_for
    from tactophone_lab.measurement.delays import measure_decisions
    from tactophone_lab.measurement.impulses import Graph, measure

    settings = options.settings_of(args)
    card = read_model(
        model_path(settings.detector.model or default_model(settings.capture.tip))
    ).card
    with ExitStack() as stack:
        server = (
            stack.enter_context(DummyServer(args.period)).name
            if args.dummy
            else settings.process.jack_server
        )
        graph = Graph(server, args.impulse_port, args.vibration_port)
        update = stack.enter_context(output.progress("impulses", 1.0))
        measured = measure(
            settings,
            graph,
            impulses=args.impulses,
            progress=lambda share: update(completed=share),
        )
        decider = None if args.no_decisions else open_pipeline_for(settings, channels=2)
        delays = measure_decisions(decider) if decider else None
    detector = decider.detector.name if decider else None
    title = "milliseconds from an impulse to the first vibration"
    rows = list(_rows(measured, delays, card))
    parts: list[output.Part] = [
        title,
        rows,
        _notes(measured, settings, dummy=args.dummy),
    ]
    if delays and detector:
        parts.append(_decision_notes(delays, detector))
    found = {
        **measured.stages,
        "sum": _sum(measured),
        "end to end": measured.end_to_end,
    }
    if delays:
        found |= {
            "contact to vibration": np.array(delays.touch),
            "edge to changed vibration": np.array(delays.edge),
        }
    values = {
        "impulses": measured.impulses,
        "missed": measured.missed,
        "missed_at_s": measured.missed_at,
        "late_to_rest": measured.late_to_rest,
        "device_losses": measured.device_losses,
        "xruns": measured.xruns,
        "period": measured.period,
        "restarts": measured.restarts,
        "disagreement_ms": 1000 * measured.disagreement,
        "milliseconds": {
            name: _percentiles_ms(durations) for name, durations in found.items()
        },
        "window_ms": 1000 * card.duration,
        "detector": detector,
    }
    output.show(values, parts, as_json=args.json)
    return 0


def _sum(measured: "ImpulseLatency") -> NDArray[np.float64]:
    total: NDArray[np.float64] = np.sum(list(measured.stages.values()), axis=0)
    return total


def _percentiles_ms(durations: NDArray[np.float64]) -> dict[str, float]:
    if not len(durations):
        return {}
    return {f"p{p}": float(1000 * np.percentile(durations, p)) for p in PERCENTILES}


SUMS = ("sum of the stages", "end to end", "window to finger")


def _rows(
    measured: "ImpulseLatency", delays: "DecisionDelays | None", card: "ModelCard"
) -> Iterator[dict[str, Any]]:
    durations = {
        **measured.stages,
        "sum of the stages": _sum(measured),
        "end to end": measured.end_to_end,
        f"window of {card.name}, all of the new surface": np.array([card.duration]),
        "window to finger": card.duration + measured.end_to_end,
    }
    if delays is not None:
        durations["decision: contact to vibration"] = np.array(delays.touch)
        durations["decision: edge to changed vibration"] = np.array(delays.edge)
    for stage, found in durations.items():
        # A server without a card delivers a period early: its negative times are those
        # of no microphone (`_notes`).
        shown = {
            f"{name:>7}": f"{max(value, 0.0):7.2f}"
            for name, value in _percentiles_ms(found).items()
        }
        yield {
            "stage": output.styled("bold", stage) if stage in SUMS else stage
        } | shown


def _notes(measured: "ImpulseLatency", settings: Settings, *, dummy: bool) -> str:
    link = settings.link
    codec = (
        link.codec
        if link.codec == "pcm16"
        else f"Opus, {1000 * link.packet_duration:g} ms"
    )
    sent = "predictions only" if link.send_predictions else codec
    words = [
        f"{measured.impulses} impulses, {measured.incidents}; periods "
        f"of {measured.period} samples "
        f"({1000 * measured.period / LIVE_SAMPLE_RATE:.2f} ms); {sent}; encrypted.",
        "The sum and the end-to-end time are measured with different clocks; "
        f"their means differ by {1000 * measured.disagreement:.2f} ms.",
    ]
    if measured.late_to_rest:
        words.append(
            "Impulses that came before the last vibration had ended are not judged."
        )
    if measured.restarts:
        words.append(
            f"A stalled side was restarted {measured.restarts} times and stayed "
            "muted: is the machine too busy?"
        )
    if dummy:
        words.append(
            "A server without a sound card delivers each period at its beginning, so "
            "capture is up to a period too "
            "short (under 0 is shown as 0): a card adds one period there, and one or "
            "two at the device."
        )
    return "\n".join(words)


def _decision_notes(delays: "DecisionDelays", model: str) -> str:
    from tactophone_lab.measurement.delays import MAX_DECISION_DELAY

    touches = len(delays.touch) + delays.missed_touches
    edges = len(delays.edge) + delays.missed_edges
    return (
        f"Decisions of the detector {model}: simulated finger, virtual time, packets "
        "of 2.5 ms; link and devices add "
        "to it. "
        f"{touches} touches, {delays.missed_touches} missed; {edges} edges between "
        "smooth and rough, "
        f"{delays.missed_edges} not detected within {MAX_DECISION_DELAY:g} s."
    )
