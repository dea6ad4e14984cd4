"""``tactophone calibrate``: check the microphones and find the contact threshold of this set-up."""

import argparse
import datetime
import math
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path

import numpy as np
from rich.console import Group
from rich.live import Live
from rich.table import Table
from rich.text import Text

from tactophone.cli._support import audio_input, keyboard, terminal
from tactophone.cli._support.audio_input import SETTLING, AudioInput, SimulatedAct
from tactophone.cli._support.meters import Meters, live_display
from tactophone.errors import DatasetError
from tactophone.perception import MICROPHONES, CalibrationResult, CalibrationSounds, measure_calibration
from tactophone.types import AudioBlock, FloatArray

STEPS = (
    (SimulatedAct("rest", 5.0), "Silence: touch nothing and keep still"),
    (SimulatedAct("stroke", 5.0), "A stroke: stroke an object that you will use, to and fro, at medium pressure"),
    (SimulatedAct("tap", 3.0), "Taps: tap on it about twice a second"),
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the verb's arguments."""
    parser.add_argument(
        "--out", type=Path, default=Path("calibration.toml"), metavar="FILE", help="calibration file to write"
    )
    parser.add_argument(
        "--false-alarms", default="1/min", metavar="N/min",
        help="false contacts to allow in silence, over 0 to 600 a minute",
    )  # fmt: skip
    parser.add_argument(
        "--object", default="smooth competition stone", metavar="NAME", help="object that the simulated finger strokes"
    )
    parser.add_argument("--yes", action="store_true", help="start each step without a key press")
    parser.add_argument("--json", action="store_true", help="print the result as JSON")
    audio_input.add_arguments(parser)


def run(args: argparse.Namespace) -> int:
    """Record silence, strokes and taps, and write the file if the set-up is good."""
    rate = per_minute(args.false_alarms)
    with AudioInput(args, args.object) as audio, keyboard.single_keys() as has_keyboard:
        sounds = _record(audio, wait=has_keyboard and not (args.yes or audio.simulated))
        made = datetime.datetime.now().isoformat(timespec="seconds")
        diagnosis = measure_calibration(sounds, made=made, source=audio.name, false_alarms_per_minute=rate)
    if diagnosis.passed:
        diagnosis.calibration.write(args.out)
    _print(args, diagnosis)
    return 0 if diagnosis.passed else 1


def per_minute(text: str) -> float:
    """Parse a rate such as ``1/min``, over 0 to 600 a minute.

    Raises
    ------
    DatasetError
        If the text is not such a rate.

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
        raise DatasetError(f"{text!r} is not a rate; write a number over 0 to 600 a minute, such as 1/min")
    return rate


def _record(audio: AudioInput, *, wait: bool) -> CalibrationSounds:
    blocks, rate = iter(audio), audio.source.sample_rate
    meters = Meters(audio.source.channels, math.nan)
    parts = []
    with live_display() as live:
        for act, instruction in STEPS:
            if wait:
                _await_key(blocks, meters, live, instruction)
            audio.ask(SimulatedAct(act.verb, act.duration + SETTLING))
            _collect(blocks, SETTLING, rate, meters, live, instruction)
            parts.append(_collect(blocks, act.duration, rate, meters, live, instruction))
    return CalibrationSounds(rate, *parts)


def _await_key(blocks: Iterator[AudioBlock], meters: Meters, live: Live | None, instruction: str) -> None:
    while True:
        meters.push(next(blocks))
        if meters.due():
            _show(live, meters, instruction, "press a key to start")
        if keyboard.read_key(0):
            return


def _collect(
    blocks: Iterator[AudioBlock], duration: float, rate: int, meters: Meters, live: Live | None, instruction: str
) -> FloatArray:
    """Return ``duration`` s of sound, shape ``(samples, channels)``."""
    parts: list[FloatArray] = []
    left = round(duration * rate)
    for block in blocks:
        parts.append(block.samples[:left])
        meters.push(block)
        left -= len(parts[-1])
        if left <= 0:
            return np.concatenate(parts)
        if meters.due():
            _show(live, meters, instruction, f"{left / rate:.1f} s")
    raise DatasetError(f"the sound ended {left / rate:.1f} s too early; calibrating takes 5 s + 5 s + 3 s of it")


def _show(live: Live | None, meters: Meters, instruction: str, state: str) -> None:
    if live is not None:
        live.update(
            Group(Text(instruction, style="bold"), *meters.rows(), Text(f" {state}", style="cyan")), refresh=True
        )


def _print(args: argparse.Namespace, diagnosis: CalibrationResult) -> None:
    if args.json:
        findings = [asdict(finding) for finding in diagnosis.findings]
        result = {"passed": diagnosis.passed, "findings": findings, "gain_db": diagnosis.gain_db}
        terminal.print_json(result | asdict(diagnosis.calibration))
        return
    calibration, out = diagnosis.calibration, terminal.out()
    table = Table("microphone", "noise floor", "hum", "stroke", "highest peak", "turn gain by", box=None)
    for channel, name in enumerate(MICROPHONES[: calibration.channels]):
        levels = (calibration.floor_dbfs, calibration.hum_dbfs, calibration.stroke_dbfs, calibration.peak_dbfs)
        gain = f"{diagnosis.gain_db[channel]:+d} dB" if diagnosis.gain_db[channel] else "-"
        table.add_row(name, *(f"{level[channel]:.1f} dBFS" for level in levels), gain)
    out.print(table)
    out.print(
        f"contact from {calibration.threshold_dbfs:.1f} dBFS (a window of 256 ms: {calibration.window_dbfs:.1f} dBFS): "
        f"at most {calibration.false_alarms_per_minute:g} false contacts a minute"
    )
    for finding in diagnosis.findings:
        mark = "[red]refused:[/]" if finding.fatal else "[yellow]note:[/]"
        out.print(f"{mark} {finding}")
    if diagnosis.passed:
        out.print(f"[green]good:[/] written to {args.out}; use it as --calibration of `record`, `train` and `receive`")
    else:
        out.print("nothing was written: correct what is refused above, and calibrate again")
