"""``tactophone setup``: fit a detector to a new finger, guided, in two minutes."""

import argparse
import datetime
import math
from collections.abc import Sequence
from contextlib import nullcontext
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from rich.table import Table

from tactophone.cli._support import audio_input, flags, keyboard, terminal
from tactophone.cli._support.audio_input import AudioInput, SimulatedAct
from tactophone.cli._support.guide_screen import GuidePage, GuideScreen
from tactophone.cli._support.guided_recording import record_step
from tactophone.cli._support.meters import Meters
from tactophone.cli._support.ranges import Within
from tactophone.errors import ConfigError, ModelError
from tactophone.json_numbers import finite
from tactophone.perception import (
    CalibrationSounds,
    Finding,
    Model,
    default_model,
    measure_calibration,
    measure_floor,
    model_path,
    read_model,
)
from tactophone.types import TIP_NAMES, AudioBlock, FloatArray

if TYPE_CHECKING:
    from tactophone.training.setup import SetUpFit

SILENCE, SLIDE = 5.0, 10.0
"""Seconds of silence, and of sliding on each object."""

SMOOTH, ROUGH = ("polished marble", "whiteboard"), ("brick", "lava stone")
"""What the simulated finger slides over, where nothing is named."""

KIND = "texture"
"""Kind of model that can be fitted."""

NOT_ASKED = ("no-tap", "faint-stroke")
"""Findings of a calibration that are about steps which are not part of this."""

TIP_PICTURE = """\
Which tip touches?  Ink it, press it on glass as hard as you will slide, and look at the mark.

     1 rubber          2 pad             3 plastic         4 stylus
     soft rubber,      hard skin on      rod or pen        steel rod
     silicone          a silicone pad    of plastic
      .-----.           .-----.             | |               | |
     (       )         (  ---  )            | |               | |
      '-___-'           '-...-'             \\_/                V
    ===========       ===========       ===========       ===========
    mark: 2 mm,       mark: 0.1 mm      mark: 0.1 mm      mark: a dot
    a round blot      to 0.5 mm
"""
"""The mark separates rubber from the rest; under rubber, impulses are no sign of roughness."""


@dataclass(frozen=True, slots=True, eq=False)
class _Recorded:
    """The sound of a set-up: silence, and each object's name, label and sound."""

    sample_rate: int
    source: str
    silence: FloatArray
    objects: list[tuple[str, bool, FloatArray]]


@dataclass(frozen=True, slots=True)
class _Result:
    """A model that was fitted, what its file holds, and what was found wrong with the microphones."""

    fit: "SetUpFit"
    findings: list[Finding]
    threshold_dbfs: float
    tip: str
    start: str
    """Name of the model that was started from."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the verb's arguments."""
    add = parser.add_argument
    add("--out", type=Path, default=Path("finger.onnx"), metavar="FILE", help="model file to write")
    add(
        "--model",
        default="",
        metavar="NAME|FILE",
        help="model of kind texture to start from; default: the shipped one for the tip",
    )
    for label, names in (("smooth", SMOOTH), ("rough", ROUGH)):
        add(
            f"--{label}", default=", ".join(names), metavar="NAMES",
            help=f"{label} objects of your own, separated by commas; two or more, as unlike as you have",
        )  # fmt: skip
    add(
        "--seconds", type=Within(float, 2, 60, unit="s"), default=SLIDE, metavar="S",
        help="of sliding on each object, %(type)s",
    )  # fmt: skip
    add("--yes", action="store_true", help="ask nothing, and start each step without a key press")
    add("--json", action="store_true", help="print the result as JSON")
    add("--dashboard", action="store_true", help="guide on a page of this machine too, and print its address")
    audio_input.add_arguments(parser)


def run(args: argparse.Namespace) -> int:
    """Ask for the tip, record, check the microphones, fit, write the model."""
    objects = [(name, label == "rough") for label in ("smooth", "rough") for name in _names(args, label)]
    page = GuidePage(wait=not args.yes) if args.dashboard else None
    with keyboard.single_keys() as has_keyboard, page or nullcontext():
        slides = (f"{name} ({'rough' if rough else 'smooth'})" for name, rough in objects)
        screen = GuideScreen(None, has_keyboard, page, steps=("tip", "silence", *slides))
        tip = _ask_tip(args, screen)
        recorded = _record(args, objects, screen)
        return _fit_and_write(args, recorded, tip, screen)


def _fit_and_write(args: argparse.Namespace, recorded: _Recorded, tip: str, screen: GuideScreen) -> int:
    start = model_path(args.model or default_model(tip))
    model = read_model(start)
    if model.card.kind != KIND:
        raise ModelError(
            f"model {model.card.name} is of kind {model.card.kind}; setup fits kind {KIND}: try --model texture"
        )
    findings = _check(recorded)
    if screen.page is not None:
        screen.page.show(findings=[str(finding) for finding in findings])
    if any(finding.fatal for finding in findings):
        _print_findings(args, findings)
        return 1
    floor = measure_floor(
        [AudioBlock(recorded.silence, recorded.sample_rate)],
        sample_rate=recorded.sample_rate,
        rule=model.card.gate.rule,
    )
    if not floor.known:
        raise ModelError("the silence was not steady: keep the finger and the table still, and run setup again")
    fit = _fit(model, recorded, threshold_dbfs=floor.threshold_dbfs, tip=tip)
    from tactophone.training.setup import write_set_up

    write_set_up(args.out, start, model, fit, threshold_dbfs=floor.threshold_dbfs, tip=tip)
    result = _Result(fit, findings, floor.threshold_dbfs, tip, model.card.name)
    content = _as_json(args.out, result)
    if args.json:
        terminal.print_json(content)
    else:
        _print(args.out, result)
    if screen.page is not None:
        screen.page.show(result=finite(content) | {"words": f"written: {args.out}; {_estimate(fit)}"})
    return 0


def _names(args: argparse.Namespace, label: str) -> list[str]:
    names = [name.strip() for name in str(getattr(args, label)).split(",") if name.strip()]
    if not names:
        raise ConfigError(f"--{label}: name a {label} object at least, such as --{label} '{', '.join(SMOOTH)}'")
    return names


def _ask_tip(args: argparse.Namespace, screen: GuideScreen) -> str:
    """Show the picture and read the answer; the setting where nobody is asked."""
    tip = flags.settings_of(args).capture.tip
    if args.yes or not screen.answers:
        return tip
    out = terminal.log()
    out.print(TIP_PICTURE, highlight=False, markup=False)
    out.print(f"press 1 to {len(TIP_NAMES)}, or any other key for {tip}")
    if screen.page is not None:
        question, _, picture = TIP_PICTURE.partition("\n\n")
        screen.begin(0)
        screen.page.show(instruction=question, picture=picture, buttons={name: name for name in TIP_NAMES})
    while not (key := screen.pressed(0.5)):
        pass
    if key in keyboard.QUIT_KEYS:
        raise KeyboardInterrupt
    if screen.page is not None:
        screen.page.show(picture="", buttons={})
    return key if key in TIP_NAMES else dict(zip("1234", TIP_NAMES, strict=True)).get(key, tip)


def _record(args: argparse.Namespace, objects: Sequence[tuple[str, bool]], screen: GuideScreen) -> _Recorded:
    recorded: list[tuple[str, bool, FloatArray]] = []
    with AudioInput(args, objects[0][0]) as audio, terminal.live_display() as live:
        wait = screen.answers and not (args.yes or audio.simulated)
        screen = replace(screen, live=live)
        screen.begin(1)
        blocks, meters = iter(audio), Meters(audio.source.channels, math.nan)
        silence = record_step(
            audio, blocks, SimulatedAct("rest", SILENCE), "Silence: touch nothing and keep still",
            meters=meters, screen=screen, wait=wait,
        )  # fmt: skip
        for number, (name, rough) in enumerate(objects):
            screen.begin(2 + number)
            instruction = f"Slide to and fro on {name} ({'rough' if rough else 'smooth'}), now fast, now slowly"
            act = SimulatedAct("stroke", args.seconds)
            if number and audio.name == "finger":
                # A simulated finger lies on one object; the same seed gives the same set-up on the next.
                with AudioInput(args, name) as other:
                    sound = record_step(other, iter(other), act, instruction, meters=meters, screen=screen, wait=wait)
            else:
                sound = record_step(audio, blocks, act, instruction, meters=meters, screen=screen, wait=wait)
            recorded.append((name, rough, sound))
        screen.begin(len(screen.steps))
        return _Recorded(audio.source.sample_rate, audio.name, silence, recorded)


def _check(recorded: _Recorded) -> list[Finding]:
    """Return what is wrong with the microphones, by the sounds of all objects."""
    strokes = np.concatenate([sound for _, _, sound in recorded.objects])
    made = datetime.datetime.now().isoformat(timespec="seconds")
    sounds = CalibrationSounds(recorded.sample_rate, recorded.silence, strokes, recorded.objects[0][2])
    result = measure_calibration(sounds, made=made, source=recorded.source)
    return [finding for finding in result.findings if finding.code not in NOT_ASKED]


def _fit(model: Model, recorded: _Recorded, *, threshold_dbfs: float, tip: str) -> "SetUpFit":
    from tactophone.training.setup import collect, fit_set_up

    rate = recorded.sample_rate
    with terminal.tracked(recorded.objects, "fitting") as objects:
        sounds = [
            collect(model, samples, sample_rate=rate, threshold_dbfs=threshold_dbfs, name=name, rough=rough)
            for name, rough, samples in objects
        ]
    return fit_set_up(sounds, channels=model.card.channels, tip=tip)


def _print_findings(args: argparse.Namespace, findings: Sequence[Finding]) -> None:
    if args.json:
        terminal.print_json({"passed": False, "findings": [finding.message for finding in findings]})
        return
    for finding in findings:
        terminal.out().print(f"{'[red]refused:[/]' if finding.fatal else '[yellow]note:[/]'} {finding}")
    terminal.out().print("nothing was written: correct what is refused above, and run setup again")


def _as_json(file: Path, result: _Result) -> dict[str, Any]:
    fit = result.fit
    objects = [{"name": e.name, "rough": e.rough, "before": e.before, "after": e.after} for e in fit.left_out]
    return {
        "passed": True, "file": str(file), "from": result.start, "tip": result.tip,
        "threshold_dbfs": result.threshold_dbfs,
        "score": fit.score, "before": fit.balanced_accuracy_before, "after": fit.balanced_accuracy, "objects": objects,
        "findings": [finding.message for finding in result.findings],
    }  # fmt: skip


def _estimate(fit: "SetUpFit") -> str:
    """Say how good the model will be."""
    after = fit.balanced_accuracy
    if math.isnan(after):
        return "one object of a kind: no estimate; name two smooth and two rough objects to have one"
    if after < 0.75:
        return "little better than chance: add objects, or check the tip that you named"
    return f"right on {_percent(after)} of what it was not fitted to, over both kinds"


def _print(file: Path, result: _Result) -> None:
    fit, start = result.fit, result.start
    before, after = fit.balanced_accuracy_before, fit.balanced_accuracy
    out = terminal.out()
    for finding in result.findings:
        out.print(f"[yellow]note:[/] {finding}")
    table = Table("object", "is", f"right, {start} as it ships", "right, left out of the fit", box=None)
    for entry in fit.left_out:
        table.add_row(entry.name, "rough" if entry.rough else "smooth", _percent(entry.before), _percent(entry.after))
    table.add_row("[bold]balanced[/]", "", _percent(before), _percent(after))
    out.print(table)
    if not fit.abstains:
        out.print(f"{_percent(fit.unknown)} of this sound is unknown to {start}: the new model never abstains")
    out.print(f"tip {result.tip}; contact from {result.threshold_dbfs:.1f} dBFS; score: {fit.score}")
    if not after >= 0.75:  # also where it is NaN
        out.print(f"[yellow]note:[/] {_estimate(fit)}")
    out.print(f"[green]written:[/] {file}; use it as --model of `feel` and `receive`")


def _percent(share: float) -> str:
    return "-" if math.isnan(share) else f"{100 * share:.0f} %"
