"""``tactophone calibrate``: is this set-up good, where does contact begin, and what should be changed?"""

import argparse
import datetime
import math
from collections.abc import Iterator
from contextlib import AbstractContextManager, nullcontext
from dataclasses import asdict
from pathlib import Path

import numpy as np
from rich.console import Group
from rich.live import Live
from rich.table import Table
from rich.text import Text

from tactophone.cli._support import audio_input as hearing
from tactophone.cli._support import keyboard as keys
from tactophone.cli._support import terminal
from tactophone.cli._support.audio_input import SETTLING, AudioInput, SimulatedAct
from tactophone.cli._support.meters import Meters
from tactophone.errors import DatasetError
from tactophone.perception.sensor_health.calibration import Diagnosis, Sounds, diagnose
from tactophone.perception.sensor_health.faults import CHANNELS
from tactophone.types import AudioBlock, FloatArray

STEPS = (
    (SimulatedAct("rest", 5.0), "Silence: touch nothing and keep still"),
    (SimulatedAct("stroke", 5.0), "A stroke: slide to and fro over something that you will use, at medium pressure"),
    (SimulatedAct("tap", 3.0), "Taps: tap on it, about twice a second"),
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the verb's arguments."""
    parser.add_argument(
        "--out", type=Path, default=Path("calibration.toml"), metavar="FILE", help="calibration file to write"
    )
    parser.add_argument(
        "--false-alarms", default="1/min", metavar="N/min",
        help="touches that may be felt in silence, over 0 to 600 a minute",
    )  # fmt: skip
    parser.add_argument(
        "--thing", default="smooth competition stone", metavar="NAME", help="what the simulated person strokes"
    )
    parser.add_argument("--yes", action="store_true", help="wait for no key before each step")
    parser.add_argument("--json", action="store_true", help="print what was found as JSON")
    hearing.add_arguments(parser)


def run(args: argparse.Namespace) -> int:
    """Listen, judge, and write the file if the set-up is good."""
    allowed = per_minute(args.false_alarms)
    with AudioInput(args, args.thing) as heard, keys.listening() as keyboard:
        sounds = _listen(heard, wait=keyboard and not (args.yes or heard.simulated))
        made = datetime.datetime.now().isoformat(timespec="seconds")
        diagnosis = diagnose(sounds, made=made, source=heard.name, false_alarms_per_minute=allowed)
    if diagnosis.blessed:
        diagnosis.calibration.write(args.out)
    _tell(args, diagnosis)
    return 0 if diagnosis.blessed else 1


def per_minute(text: str) -> float:
    """Read a rate such as ``1/min``.

    Raises
    ------
    DatasetError
        If it is none.

    Examples
    --------
    >>> per_minute("0.5/min")
    0.5
    """
    number, _, unit = text.partition("/")
    try:
        rate = float(number)
    except ValueError:
        rate = math.nan
    if unit not in ("", "min") or not 0 < rate <= 600:
        raise DatasetError(f"{text!r} is no rate; write a number over 0 to 600 a minute, such as 1/min")
    return rate


def _listen(heard: AudioInput, *, wait: bool) -> Sounds:
    blocks = iter(heard)
    meters = Meters(heard.source.channels, math.nan)
    parts = []
    with _live() as live:
        for act, words in STEPS:
            if wait:
                _await_key(blocks, meters, live, words)
            heard.ask(SimulatedAct(act.verb, act.duration + SETTLING))
            _collect(blocks, SETTLING, heard.source.sample_rate, meters, live, words)
            parts.append(_collect(blocks, act.duration, heard.source.sample_rate, meters, live, words))
    return Sounds(heard.source.sample_rate, *parts)


def _await_key(blocks: Iterator[AudioBlock], meters: Meters, live: Live | None, words: str) -> None:
    while True:
        meters.push(next(blocks))
        if meters.due():
            _show(live, meters, words, "press a key to begin")
        if keys.pressed(0):
            return


def _collect(
    blocks: Iterator[AudioBlock], duration: float, rate: int, meters: Meters, live: Live | None, words: str
) -> FloatArray:
    """Listen for a while."""
    parts: list[FloatArray] = []
    left = round(duration * rate)
    for block in blocks:
        parts.append(block.samples[:left])
        meters.push(block)
        left -= len(parts[-1])
        if left <= 0:
            return np.concatenate(parts)
        if meters.due():
            _show(live, meters, words, f"{left / rate:.1f} s")
    raise DatasetError(f"the sound ended {left / rate:.1f} s too early; calibrating takes 5 s + 5 s + 3 s of it")


def _live() -> AbstractContextManager[Live | None]:
    console = terminal.log()
    return Live(console=console, auto_refresh=False, transient=True) if console.is_terminal else nullcontext()


def _show(live: Live | None, meters: Meters, words: str, state: str) -> None:
    if live is not None:
        live.update(Group(Text(words, style="bold"), *meters.rows(), Text(f" {state}", style="cyan")), refresh=True)


def _tell(args: argparse.Namespace, diagnosis: Diagnosis) -> None:
    if args.json:
        findings = [asdict(finding) for finding in diagnosis.findings]
        told = {"blessed": diagnosis.blessed, "findings": findings, "gain_db": diagnosis.gain_db}
        terminal.print_json(told | asdict(diagnosis.calibration))
        return
    calibration, out = diagnosis.calibration, terminal.out()
    table = Table("microphone", "noise floor", "of that hum", "stroke", "highest peak", "turn gain by", box=None)
    for channel, name in enumerate(CHANNELS[: calibration.channels]):
        levels = (calibration.floor_dbfs, calibration.hum_dbfs, calibration.stroke_dbfs, calibration.peak_dbfs)
        gain = f"{diagnosis.gain_db[channel]:+d} dB" if diagnosis.gain_db[channel] else "-"
        table.add_row(name, *(f"{level[channel]:.1f} dBFS" for level in levels), gain)
    out.print(table)
    out.print(
        f"contact from {calibration.threshold_dbfs:.1f} dBFS (a window of 256 ms: {calibration.window_dbfs:.1f} dBFS): "
        f"at most {calibration.false_alarms_per_minute:g} false touches a minute"
    )
    for finding in diagnosis.findings:
        mark = "[red]refused:[/]" if finding.fatal else "[yellow]note:[/]"
        out.print(f"{mark} {finding}")
    if diagnosis.blessed:
        words = f"[green]good:[/] written to {args.out}; `record`, `train` and `receive` take it as --calibration"
        out.print(words)
    else:
        out.print("nothing was written: change what is refused above, and calibrate again")
