"""``tactophone calibrate``: check the microphones and find the contact threshold of this set-up."""

import argparse
import datetime
import math
from dataclasses import asdict
from pathlib import Path

from rich.table import Table

from tactophone.cli._support import audio_input, keyboard, terminal
from tactophone.cli._support.audio_input import AudioInput, SimulatedAct
from tactophone.cli._support.guide_screen import GuideScreen
from tactophone.cli._support.guided_recording import record_step
from tactophone.cli._support.meters import Meters
from tactophone.errors import DatasetError
from tactophone.perception import MICROPHONES, CalibrationResult, CalibrationSounds, measure_calibration

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
    blocks, meters = iter(audio), Meters(audio.source.channels, math.nan)
    with terminal.live_display() as live:
        parts = [
            record_step(audio, blocks, act, instruction, meters=meters, screen=GuideScreen(live, wait), wait=wait)
            for act, instruction in STEPS
        ]
    return CalibrationSounds(audio.source.sample_rate, *parts)


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
