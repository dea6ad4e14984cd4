"""``tactophone latency``: clicks through the running chain, and the budget stage by stage."""

import argparse
from contextlib import ExitStack

import numpy as np
from numpy.typing import NDArray
from rich.table import Table

from tactophone.cli._support import flags, terminal
from tactophone.config import Settings
from tactophone.devices import DummyServer
from tactophone.measurement.decision_delay import LONGEST, Delays, measure_decisions
from tactophone.measurement.impulse_latency import Measured
from tactophone.measurement.latency import Graph, measure
from tactophone.runtime.wiring import SAMPLE_RATE, open_pipeline_for
from tactophone.telemetry import STAGES

FLAGS = {
    "--codec": "link.codec",
    "--packet": "link.packet_duration",
    "--judge": "link.judge",
    "--model": "judge.model",
    "--name": "process.name",
}

PERCENTILES = (50, 95, 99)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the verb's arguments."""
    flags.add_settings(parser, FLAGS)
    add = parser.add_argument
    add("--clicks", type=int, default=100, metavar="N", help="clicks to play, 10 to 2000, about 4 a second")
    add("--dummy", action="store_true", help="start a JACK server without a sound card for this")
    add("--period", type=int, default=128, metavar="N", help="samples a period of that server, 32 to 1024")
    add("--click-to", default="", metavar="PORT", help="JACK port of a loudspeaker or cable to the microphones")
    add("--felt-from", default="", metavar="PORT", help="JACK port of a sensor or cable on the actuator")
    add("--clicks-only", action="store_true", help="leave out how long the decision takes (simulated, 10 s)")
    add("--json", action="store_true", help="print all figures for a program")


def run(args: argparse.Namespace) -> int:
    """Measure and print."""
    settings = flags.settings_of(args)
    with ExitStack() as stack:
        server = stack.enter_context(DummyServer(args.period)).name if args.dummy else settings.process.jack_server
        graph = Graph(server, args.click_to, args.felt_from)
        bar = stack.enter_context(terminal.progress("clicking"))
        task = bar.add_task("", total=1.0, note="")
        measured = measure(
            settings, graph, clicks=args.clicks, progress=lambda share: bar.update(task, completed=share)
        )
        delays = None if args.clicks_only else measure_decisions(open_pipeline_for(settings, channels=2))
    if args.json:
        terminal.print_json(as_figures(measured, delays))
        return 0
    terminal.out().print(_table(measured, delays))
    terminal.out().print(_words(measured, settings, dummy=args.dummy), soft_wrap=True)
    if delays is not None:
        terminal.out().print(_words_of_decisions(delays), soft_wrap=True)
    return 0


def as_figures(measured: Measured, delays: Delays | None) -> dict[str, object]:
    """Give percentiles in milliseconds, by stage and end to end, and of the decision."""
    rows = {**measured.stages, "sum": _sum(measured), "end to end": measured.end_to_end}
    if delays is not None:
        rows |= {"contact to felt": np.array(delays.touch), "edge to changed feel": np.array(delays.edge)}
    percentiles = {name: _percentiles_ms(durations) for name, durations in rows.items()}
    counts = {"clicks": measured.clicks, "missed": measured.missed, "period": measured.period}
    counts["restarts"] = measured.restarts
    return {**counts, "disagreement_ms": 1000 * measured.disagreement, "milliseconds": percentiles}


def _sum(measured: Measured) -> NDArray[np.float64]:
    total: NDArray[np.float64] = np.sum(list(measured.stages.values()), axis=0)
    return total


def _percentiles_ms(durations: NDArray[np.float64]) -> dict[str, float]:
    if not len(durations):
        return {}
    return {f"p{p}": float(1000 * np.percentile(durations, p)) for p in PERCENTILES}


def _table(measured: Measured, delays: Delays | None) -> Table:
    table = Table(title="milliseconds from a click to the first vibration", box=None, pad_edge=False)
    table.add_column("stage")
    for percentile in PERCENTILES:
        table.add_column(f"p{percentile}", justify="right")
    for stage in STAGES:
        table.add_row(stage, *_cells(measured.stages[stage]))
    table.add_row("sum of the stages", *_cells(_sum(measured)), style="bold")
    table.add_row("end to end", *_cells(measured.end_to_end), style="bold")
    if delays is not None:
        table.add_section()
        table.add_row("decision: contact to felt", *_cells(np.array(delays.touch)))
        table.add_row("decision: edge to changed feel", *_cells(np.array(delays.edge)))
    return table


def _cells(durations: NDArray[np.float64]) -> list[str]:
    return [f"{value:.2f}" for value in _percentiles_ms(durations).values()]


def _words(measured: Measured, settings: Settings, *, dummy: bool) -> str:
    link = settings.link
    codec = link.codec if link.codec == "pcm16" else f"Opus, {1000 * link.packet_duration:g} ms"
    sent = "belief alone" if link.judge else codec
    words = [
        f"{measured.clicks} clicks, {measured.missed} not felt; periods of {measured.period} samples "
        f"({1000 * measured.period / SAMPLE_RATE:.2f} ms); {sent}; sealed.",
        "Sum and end to end are measured with different clocks; "
        f"their means differ by {1000 * measured.disagreement:.2f} ms.",
    ]
    if measured.restarts:
        words.append(
            f"A stalled side was begun again {measured.restarts} times and stayed muted: is the machine too busy?"
        )
    if dummy:
        words.append(
            "A server without a card hands a period over at its beginning, so capture comes out up to a period early: "
            "a card adds one period there, and one or two at the device."
        )
    return "\n".join(words)


def _words_of_decisions(delays: Delays) -> str:
    touches, edges = len(delays.touch) + delays.missed_touches, len(delays.edge) + delays.missed_edges
    return (
        "Decisions: simulated finger, virtual time, packets of 2.5 ms; line and devices come on top. "
        f"{touches} touches, {delays.missed_touches} not felt; {edges} edges between smooth and rough, "
        f"{delays.missed_edges} not told in {LONGEST:g} s."
    )
