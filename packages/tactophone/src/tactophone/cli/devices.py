"""``tactophone devices`` and ``settings``: the sound devices of this machine, what they
play, and what can be set."""

import argparse
import json
import math
import sys
import time
from itertools import groupby
from pathlib import Path
from typing import TYPE_CHECKING, Any

from rich.table import Table

from tactophone.cli import options, output
from tactophone.cli.options import Within
from tactophone.core.errors import ConfigError, DeviceError
from tactophone.core.processes import make_room
from tactophone.core.settings import SETTINGS, Settings
from tactophone.core.types import FloatArray, HapticCommand
from tactophone.live.audio.device import Device, Process
from tactophone.live.audio.jack import JackClient
from tactophone.live.audio.portaudio import PortAudioStream
from tactophone.live.audio.survey import SurveyedDevice, survey
from tactophone.signal.haptics.limits import Limits
from tactophone.signal.haptics.oscillator import Oscillator
from tactophone.signal.haptics.profiles import ROUGH_STIMULUS, SMOOTHEST_STIMULUS

if TYPE_CHECKING:
    from tactophone.app.sweep import MeasuredResponse

EXAMPLES = {
    "devices": (
        "tactophone devices --json",
        "tactophone devices feel --actuator jack",
        (
            "tactophone devices measure --actuator portaudio:DualSense "
            "--source portaudio:2"
        ),
    ),
    "settings": (
        "tactophone settings > robot.toml",
        "tactophone send --settings robot.toml --set link.port=48471",
    ),
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    if parser.get_default("verb") == "settings":
        return
    add(
        "step",
        nargs="?",
        choices=("feel", "measure"),
        help=(
            "feel: play bursts that grow until you feel them; measure: play a sweep on "
            "the actuator, record it with the contact microphone, write actuator.toml"
        ),
    )
    add(
        "--amplitude",
        type=Within(float, 0, Limits().ceiling, over=True, unit="of full drive"),
        default=0.2,
        metavar="SHARE",
        help="measure: amplitude of the sweep, %(type)s; at most rendering.ceiling",
    )
    add(
        "--out",
        type=Path,
        default=Path("actuator.toml"),
        metavar="FILE",
        help="measure: settings file to write",
    )
    options.add_json(parser, "print a list that a program can read")
    options.add_settings(parser, "devices")
    options.add_finger(parser)


def run(args: argparse.Namespace) -> int:
    if args.verb == "settings":
        for section, entries in groupby(
            SETTINGS.values(), key=lambda entry: entry.name.partition(".")[0]
        ):
            print(f"[{section}]")
            for entry in entries:
                print(f"# {entry.help}")
                text = isinstance(entry.default, str | bool)
                value = (
                    json.dumps(entry.default, ensure_ascii=False)
                    if text
                    else entry.default
                )
                print(f"{entry.name.partition('.')[2]} = {value}\n")
        return 0
    settings = options.settings_of(args)
    if args.step:
        try:
            return (
                _measure(args, settings) if args.step == "measure" else _feel(settings)
            )
        except EOFError:
            raise ConfigError(
                "devices feel asks what you felt, but nobody can answer: run it on a "
                "terminal"
            ) from None
    found = survey(jack_server=settings.process.jack_server)
    output.show(found, map(_card, found), as_json=args.json)
    if not args.json and all(
        device.microphones and device.actuator for device in found
    ):
        output.log().print(
            "No device here is suitable. `tactophone loopback --source finger "
            "--actuator none` needs no device."
        )
    return 0


def _card(device: SurveyedDevice) -> Table:
    rate = (
        f", {device.inputs} in, {device.outputs} out, {device.sample_rate} Hz"
        if device.sample_rate
        else ""
    )
    name = f": {device.name}" if device.name else ""
    rows: list[tuple[str, Any]] = [
        ("device", output.styled("bold", device.system, f"{name}{rate}"))
    ]
    if device.microphones == device.actuator and device.microphones:
        rows.append(("not suitable", device.microphones))
    else:
        rows.append(
            ("microphones", device.microphones or output.styled("green", "yes"))
        )
        rows.append(("actuator", device.actuator or output.styled("green", "yes")))
    if device.note:
        rows.append(("note", device.note))
    if device.settings:
        rows.append(
            ("use with", " ".join(f"--set {setting}" for setting in device.settings))
        )
    return output.listing([*rows, ("", "")], justify="right", min_width=12)


BURST = 0.5
"""Seconds of a burst."""

STEPS_DB = range(-50, 1, 5)
"""Levels of the bursts, in dB under the ceiling, at which a call renders rough."""


QUICKEST = 0.2
"""Seconds that a person takes to answer at least: a paste, or Enter that is held, comes
faster."""


def _answer(question: str) -> str:
    """Ask a person, again where the answer was typed before or with the question: a
    stronger burst may follow."""
    while True:
        if attended := sys.stdin is not None and sys.stdin.isatty():
            import termios

            termios.tcflush(sys.stdin, termios.TCIFLUSH)
        asked = time.monotonic()
        answer = input(question)
        if not attended or time.monotonic() - asked >= QUICKEST:
            return answer


def _feel(settings: Settings) -> int:
    """Play bursts at both ends of the default profile, ever louder, until the operator
    feels one."""
    from tactophone.live.runtime.guard import guarded
    from tactophone.live.runtime.wiring import open_actuator

    oscillator = Oscillator(Limits(ceiling=settings.rendering.ceiling))
    now = ROUGH_STIMULUS

    def felt(level_db: int) -> bool:
        amplitude = oscillator.limits.ceiling * 10 ** (level_db / 20)
        # A vibration without commands fades, so the command is repeated.
        for _ in range(round(BURST / 0.01)):
            oscillator.submit(HapticCommand(amplitude, now.frequency, 0.0))
            time.sleep(0.01)
        if actuator.device.fault:
            raise DeviceError(actuator.device.fault)
        question = f"{now.frequency:3.0f} Hz, {level_db:3d} dB: felt? [y/N] "
        return _answer(question).strip().lower() in ("y", "yes")

    print(
        f"Bursts of {BURST:g} s, from faint to at most {oscillator.limits.ceiling:.0%} "
        "of full drive; Ctrl-C ends them."
    )
    _answer("Lay a finger on the actuator, and press Enter. ")
    lacking_db: list[float] = []
    with (
        guarded(settings, settings.process.name or "devices") as guard,
        open_actuator(
            settings,
            guard.watched(lambda outs: oscillator.render(outs[0])),
            roughness=lambda: float(now is ROUGH_STIMULUS),
            ceiling=lambda: oscillator.limits.ceiling,
        ) as actuator,
    ):
        for now, word in ((ROUGH_STIMULUS, "rough"), (SMOOTHEST_STIMULUS, "smoothest")):
            first = next(filter(felt, STEPS_DB), math.inf)
            lacking_db.append(first - now.level_dbfs)
            found = f"from {first} dB on" if first < 1 else "not at all"
            print(
                f"{word}: {found}; the profile graded renders it at "
                f"{now.level_dbfs:.0f} dB"
            )
    more = (
        f"by {max(lacking_db):.0f} dB"
        if max(lacking_db) < math.inf
        else "and check cable, port and device"
    )
    print(
        f"Turn the amplifier up {more}, then try again."
        if max(lacking_db) > 0
        else "You will feel both in a call."
    )
    return int(max(lacking_db) > 0)


def _measure(args: argparse.Namespace, settings: Settings) -> int:
    from tactophone.app.sweep import fit

    if settings.output.actuator not in ("jack", "portaudio"):
        raise ConfigError(
            "devices measure needs an actuator that plays any waveform: --actuator "
            "jack or portaudio"
        )
    output.refuse_unwritable(args.out)
    amplitude = min(args.amplitude, settings.rendering.ceiling)
    lowered = " (the ceiling)" if amplitude < args.amplitude else ""
    output.log().print(
        "Hold the contact microphone against the actuator; take the finger away. A "
        f"sweep of 8 s follows, at {amplitude:g} of full drive{lowered}."
    )
    found = fit(_record(amplitude, settings))
    make_room(args.out)
    args.out.write_text(as_toml(found), encoding="utf-8")
    print(f"resonance:  {found.resonance:.0f} Hz")
    print(
        f"band:       {found.lowest:.0f} to {found.highest:.0f} Hz, within 10 dB of it"
    )
    print(f"over noise: {found.snr_db:.0f} dB")
    print(
        f"written:    {args.out}; use it with `tactophone receive --settings "
        f"{args.out}`"
    )
    return 0


def as_toml(found: "MeasuredResponse") -> str:
    """Return a settings file with the figures; the settings check them when they are
    read."""
    # The microphone's own response is in these levels; where they fall deep, full drive
    # could not make up for it.
    pairs = zip(found.frequencies, found.levels_db, strict=True)
    levels = ",".join(
        f"{frequency:.1f}:{level:.1f}" for frequency, level in pairs if level > -40
    )
    lines = (
        "# Written by `tactophone devices measure`.",
        "[actuator]",
        f"resonance = {found.resonance:.1f}",
        f"lowest = {found.lowest:.1f}",
        f"highest = {found.highest:.1f}",
        f'response = "{levels}"',
    )
    return "\n".join(lines) + "\n"


def _record(amplitude: float, settings: Settings) -> FloatArray:
    from tactophone.app.sweep import SweepRecorder, sweep
    from tactophone.live.runtime.guard import guarded
    from tactophone.live.runtime.wiring import open_actuator

    recorder = SweepRecorder(sweep(amplitude))
    with guarded(settings, settings.process.name or "devices") as guard:
        play = guard.watched(lambda outs: recorder.play(outs[0]))
        return recorder.run(
            lambda process: _input(process, settings),
            lambda: open_actuator(settings, play).device,
        )


def _input(process: Process, settings: Settings) -> Device:
    capture = settings.capture
    if capture.source == "jack":
        server = settings.process.jack_server
        return JackClient(
            "tactophone-measure",
            process,
            inputs={"contact": capture.contact},
            outputs={},
            server=server,
        )
    if capture.source in ("portaudio", "microphone"):
        return PortAudioStream(process, "input", device=capture.device)
    raise ConfigError(
        f"capture.source = {capture.source!r} is no input of this machine: --source "
        "jack or portaudio"
    )
