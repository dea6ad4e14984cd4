"""``tactophone devices measure``: play a sweep on the actuator, record it, and write what the actuator plays."""

import argparse
from pathlib import Path
from typing import TYPE_CHECKING

from tactophone.cli._support import terminal
from tactophone.cli._support.ranges import Within
from tactophone.devices import Device, JackClient, PortAudioStream, Process
from tactophone.errors import ConfigError
from tactophone.haptics import Limits
from tactophone.settings import Settings
from tactophone.types import FloatArray

if TYPE_CHECKING:
    from tactophone.measurement.sweep import MeasuredResponse

FLAGS = {
    "--actuator": "output.actuator",
    "--device": "output.device",
    "--actuator-port": "output.port",
    "--actuator-channel": "output.channel",
    "--source": "capture.source",
    "--input-device": "capture.device",
    "--contact": "capture.contact",
}


def measure(args: argparse.Namespace, settings: Settings) -> int:
    """Measure, print the figures and write them as a settings file."""
    from tactophone.measurement.sweep import fit

    if settings.output.actuator not in ("jack", "portaudio"):
        raise ConfigError("devices measure needs an actuator that plays any waveform: --actuator jack or portaudio")
    terminal.log().print(
        "Hold the contact microphone against the actuator; take the finger away. A sweep of 8 s follows."
    )
    found = fit(_record(args.amplitude, settings))
    args.out.write_text(as_toml(found), encoding="utf-8")
    print(f"resonance:  {found.resonance:.0f} Hz")
    print(f"band:       {found.lowest:.0f} to {found.highest:.0f} Hz, within 10 dB of it")
    print(f"over noise: {found.snr_db:.0f} dB")
    print(f"written:    {args.out}; use it with `tactophone receive --config {args.out}`")
    return 0


def as_toml(found: "MeasuredResponse") -> str:
    """Return a settings file with the figures; the settings check them when they are read."""
    # The microphone's own response is in these levels; where they fall deep, full drive could not make up for it.
    pairs = zip(found.frequencies, found.levels_db, strict=True)
    levels = ",".join(f"{frequency:.1f}:{level:.1f}" for frequency, level in pairs if level > -40)
    lines = (
        "# Written by `tactophone devices measure`.",
        "[actuator]",
        f"resonance = {found.resonance:.1f}",
        f"lowest = {found.lowest:.1f}",
        f"highest = {found.highest:.1f}",
        f'response = "{levels}"',
    )
    return "\n".join(lines) + "\n"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare what ``measure`` needs beside the settings."""
    parser.add_argument(
        "--amplitude", type=Within(float, 0, Limits().ceiling, over=True, unit="of full drive"), default=0.2,
        metavar="SHARE", help="measure: of the sweep, %(type)s",
    )  # fmt: skip
    parser.add_argument(
        "--out", type=Path, default=Path("actuator.toml"), metavar="FILE", help="measure: settings file to write"
    )


def _record(amplitude: float, settings: Settings) -> FloatArray:
    from tactophone.measurement.sweep import SweepRecorder, sweep
    from tactophone.runtime import open_actuator

    recorder = SweepRecorder(sweep(amplitude))

    def open_input(process: Process) -> Device:
        return _input(process, settings)

    def open_output() -> Device:
        return open_actuator(settings, lambda outs: recorder.play(outs[0])).device

    return recorder.run(open_input, open_output)


def _input(process: Process, settings: Settings) -> Device:
    capture = settings.capture
    if capture.source == "jack":
        server = settings.process.jack_server
        return JackClient("tactophone-measure", process, inputs={"contact": capture.contact}, outputs={}, server=server)
    if capture.source in ("portaudio", "microphone"):
        return PortAudioStream(process, "input", device=capture.device)
    raise ConfigError(f"capture.source = {capture.source!r} is no input of this machine: --source jack or portaudio")
