"""``tactophone setup``: fit a detector to a new finger, guided, in two minutes; or check its microphones."""

import argparse
import datetime
import math
from collections.abc import Iterator, Sequence
from contextlib import nullcontext
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from rich.markup import escape

from tactophone.app.sources import AudioInput, SimulatedAct
from tactophone.cli import console, options, output
from tactophone.cli.guide import GuidePage, GuideScreen, Meters, record_step
from tactophone.cli.options import Within
from tactophone.core.errors import ConfigError, ModelError
from tactophone.core.microphones import MICROPHONES
from tactophone.core.types import DEFAULT_TIP, TIP_NAMES, AudioBlock, FloatArray
from tactophone.signal.perception.calibration import CalibrationResult, CalibrationSounds, Finding, measure_calibration
from tactophone.signal.perception.model_file import Model, read_model
from tactophone.signal.perception.models import default_model, model_path, open_detector
from tactophone.signal.perception.noise_floor import measure_floor

if TYPE_CHECKING:
    from tactophone.lab.training.setup import SetUpFit

SILENCE, SLIDE = 5.0, 10.0
"""Seconds of silence, and of sliding on each object."""

SMOOTH, ROUGH = ("polished marble", "whiteboard"), ("brick", "lava stone")
"""What the simulated finger slides over, where nothing is named."""

KIND = "texture"
"""Kind of model that can be fitted."""

NOT_ASKED = ("no-tap", "faint-stroke")
"""Findings of a calibration that are about steps which are not part of this."""

CHECK_STEPS = (
    (SimulatedAct("rest", 5.0), "Silence: touch nothing and keep still"),
    (SimulatedAct("stroke", 5.0), "A stroke: stroke an object that you will use, to and fro, at medium pressure"),
    (SimulatedAct("tap", 3.0), "Taps: tap on it about twice a second"),
)
"""What `--check` asks for."""

CHECKED_OBJECT = "smooth competition stone"
"""What the simulated finger strokes in a check, where no smooth object is named."""

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


EXAMPLES = (
    "tactophone setup --smooth 'glass,planed wood' --rough 'brick,slate'",
    "tactophone setup --check --out calibration.toml",
    "tactophone setup --source finger --set simulation.gain_db=-20 --seconds 2 --yes",
)


@dataclass(frozen=True, slots=True)
class Fitted:
    """A model that was fitted, what its file holds, and what was found wrong with the microphones."""

    file: Path
    fit: "SetUpFit"
    findings: list[Finding]
    threshold_dbfs: float
    tip: str
    start: str
    """Name of the model that was started from."""

    def as_json(self) -> dict[str, Any]:
        fit = self.fit
        return {
            "passed": True, "file": self.file, "from": self.start, "tip": self.tip,
            "threshold_dbfs": self.threshold_dbfs,
            "score": fit.score, "before": fit.balanced_accuracy_before, "after": fit.balanced_accuracy,
            "objects": fit.left_out, "findings": [finding.message for finding in self.findings],
        }  # fmt: skip

    def parts(self) -> Iterator[output.Part]:
        fit, start = self.fit, self.start
        before, after = fit.balanced_accuracy_before, fit.balanced_accuracy
        yield from _words(self.findings)
        rows = [(escape(e.name), "rough" if e.rough else "smooth", e.before, e.after) for e in fit.left_out]
        yield [
            {"object": name, "is": kind, f"right, {start} as it ships": output.percent(shipped),
             "right, left out of the fit": output.percent(own)}
            for name, kind, shipped, own in [*rows, ("[bold]balanced[/]", "", before, after)]
        ]  # fmt: skip
        if not fit.abstains:
            unknown = output.percent(fit.unknown)
            yield f"{unknown} of this sound is unknown to {start}: the new model never abstains"
        if fit.keeps:
            yield f"nothing here proves the boundary of {start} wrong: it stays, with tip and threshold of your own"
        yield f"tip {self.tip}; contact from {self.threshold_dbfs:.1f} dBFS; score: {fit.score}"
        if not after >= 0.75:  # also where it is NaN
            yield f"[yellow]note:[/] {_estimate(fit)}"
        tip = "" if self.tip == DEFAULT_TIP else f"--tip {self.tip} "
        yield f"[green]written:[/] {escape(str(self.file))}; use it as {tip}--model of `feel` and `receive`"


def _checked(found: CalibrationResult, file: Path) -> Iterator[output.Part]:
    calibration, gains = found.calibration, found.gain_db
    yield [
        {
            "microphone": name,
            "noise floor": f"{calibration.floor_dbfs[channel]:.1f} dBFS",
            "hum": f"{calibration.hum_dbfs[channel]:.1f} dBFS",
            "stroke": f"{calibration.stroke_dbfs[channel]:.1f} dBFS",
            "highest peak": f"{calibration.peak_dbfs[channel]:.1f} dBFS",
            "turn gain by": f"{gains[channel]:+d} dB" if gains[channel] else "-",
        }
        for channel, name in enumerate(MICROPHONES[: calibration.channels])
    ]
    yield (
        f"contact from {calibration.threshold_dbfs:.1f} dBFS (a window of 256 ms: {calibration.window_dbfs:.1f} "
        f"dBFS): at most {calibration.false_alarms_per_minute:g} false contacts a minute"
    )
    yield from _words(found.findings)
    if found.passed:
        name = escape(str(file))
        yield f"[green]good:[/] written to {name}; use it as --calibration of `record`, `train` and `receive`"
    else:
        yield "nothing was written: correct what is refused above, and check again"


def _words(findings: Sequence[Finding]) -> Iterator[str]:
    for finding in findings:
        yield f"{'[red]refused:[/]' if finding.fatal else '[yellow]note:[/]'} {finding}"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    add("--out", type=Path, metavar="FILE", help="file to write (default: finger.onnx; with --check calibration.toml)")
    add("--model", default="", metavar="NAME|FILE",
        help="model of kind texture to start from; default: the shipped one for the tip")  # fmt: skip
    for label, names in (("smooth", SMOOTH), ("rough", ROUGH)):
        add(
            f"--{label}",
            metavar="NAMES",
            help=f"{label} objects of your own, separated by commas; two or more, as unlike as you have (default: "
            f"{', '.join(names)})",
        )
    add("--seconds", type=Within(float, 2, 60, unit="s"), default=SLIDE, metavar="S",
        help="of sliding on each object, %(type)s")  # fmt: skip
    add("--yes", action="store_true", help="ask nothing, and start each step without a key press")
    options.add_json(parser, "print the result as JSON")
    add("--dashboard", action="store_true", help="guide on a page of this machine too, and print its address")
    add(
        "--check",
        action="store_true",
        help="only check the microphones and measure noise floor and contact threshold: silence, strokes, taps; writes "
        "a calibration file, by default calibration.toml",
    )
    add("--false-alarms", default="1/min", metavar="N/min",
        help="with --check: false contacts to allow in silence, over 0 to 600 a minute")  # fmt: skip
    options.add_settings(parser, "setup")
    options.add_finger(parser)


def run(args: argparse.Namespace) -> int:
    if args.check:
        return _check_set_up(args)
    args.out = args.out or Path("finger.onnx")
    objects = [(name, label == "rough") for label in ("smooth", "rough") for name in _names(args, label)]
    page = GuidePage(wait=not args.yes) if args.dashboard else None
    with console.single_keys() as has_keyboard, page or nullcontext():
        slides = (f"{name} ({'rough' if rough else 'smooth'})" for name, rough in objects)
        screen = GuideScreen(None, has_keyboard, page, steps=("tip", "silence", *slides))
        tip = _ask_tip(args, screen)
        recorded = _record(args, objects, screen)
        return _fit_and_write(args, recorded, tip, screen)


def _fit_and_write(args: argparse.Namespace, recorded: _Recorded, tip: str, screen: GuideScreen) -> int:
    name = args.model or default_model(tip)
    start = model_path(name)
    model = read_model(start)
    if model.card.kind != KIND:
        raise ModelError(
            f"model {model.card.name} is of kind {model.card.kind}; setup fits kind {KIND}: try --model texture"
        )
    findings = _check(recorded)
    if screen.page is not None:
        screen.page.show(findings=[str(finding) for finding in findings])
    if any(finding.fatal for finding in findings):
        words = "nothing was written: correct what is refused above, and run setup again"
        messages = [finding.message for finding in findings]
        output.show({"passed": False, "findings": messages}, [*_words(findings), words], as_json=args.json)
        return 1
    floor = measure_floor(
        [AudioBlock(recorded.silence, recorded.sample_rate)],
        sample_rate=recorded.sample_rate,
        rule=model.card.gate.rule,
    )
    if not floor.known:
        raise ModelError("the silence was not steady: keep the finger and the table still, and run setup again")
    fit = _fit(model, recorded, threshold_dbfs=floor.threshold_dbfs, tip=tip)
    findings += _misfits(name, recorded, threshold_dbfs=floor.threshold_dbfs)
    from tactophone.lab.training.setup import write_set_up

    write_set_up(args.out, start, model, fit, threshold_dbfs=floor.threshold_dbfs, tip=tip)
    result = Fitted(args.out, fit, findings, floor.threshold_dbfs, tip, model.card.name)
    output.show(result, result.parts(), as_json=args.json)
    if screen.page is not None:
        content = output.finite(output.as_values(result))
        words = f"written: {args.out}; {_estimate(fit)}. Now feel with it: tactophone receive --model {args.out}"
        screen.page.show(result=content | {"words": words})
    return 0


def _names(args: argparse.Namespace, label: str) -> list[str]:
    given, usual = getattr(args, label), {"smooth": SMOOTH, "rough": ROUGH}[label]
    names = list(usual) if given is None else [name.strip() for name in given.split(",") if name.strip()]
    if not names:
        raise ConfigError(f"--{label}: name a {label} object at least, such as --{label} '{', '.join(SMOOTH)}'")
    return names


def _ask_tip(args: argparse.Namespace, screen: GuideScreen) -> str:
    """Show the picture and read the answer; the setting where nobody is asked."""
    tip = options.settings_of(args).capture.tip
    if args.yes or not screen.answers:
        return tip
    out = output.log()
    out.print(TIP_PICTURE, highlight=False, markup=False)
    out.print(f"press 1 to {len(TIP_NAMES)}, or any other key for {tip}")
    if screen.page is not None:
        question = TIP_PICTURE.partition("\n\n")[0]
        screen.begin(0)
        screen.page.show(instruction=question, buttons={name: name for name in TIP_NAMES})
    while not (key := screen.pressed(0.5)):
        pass
    if key in console.QUIT_KEYS:
        raise KeyboardInterrupt
    if screen.page is not None:
        screen.page.show(instruction="Opening the microphones ...", buttons={})
    return key if key in TIP_NAMES else dict(zip("1234", TIP_NAMES, strict=True)).get(key, tip)


def _record(args: argparse.Namespace, objects: Sequence[tuple[str, bool]], screen: GuideScreen) -> _Recorded:
    recorded: list[tuple[str, bool, FloatArray]] = []
    with AudioInput(options.settings_of(args), objects[0][0]) as audio, output.live_display() as live:
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
                with AudioInput(options.settings_of(args), name) as other:
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
    from tactophone.lab.training.setup import collect, fit_set_up

    rate = recorded.sample_rate
    with output.tracked(recorded.objects, "fitting") as objects:
        sounds = [
            collect(model, samples, sample_rate=rate, threshold_dbfs=threshold_dbfs, name=name, rough=rough)
            for name, rough, samples in objects
        ]
    return fit_set_up(sounds, channels=model.card.channels, tip=tip)


def _misfits(name: str, recorded: _Recorded, *, threshold_dbfs: float) -> list[Finding]:
    """Return what of the sound does not fit a shipped model: a missing band, noise, another tip."""
    detector = open_detector(name, sample_rate=recorded.sample_rate, fast_contact=False)
    detector.threshold.dbfs = threshold_dbfs
    sound = np.concatenate((recorded.silence, *(each for _, _, each in recorded.objects)))
    detector.push(AudioBlock(sound, recorded.sample_rate))
    return [Finding(detector.misfit.code, detector.misfit.text, fatal=False)] if detector.misfit else []


def _check_set_up(args: argparse.Namespace) -> int:
    rate, path = options.per_minute(args.false_alarms), args.out or Path("calibration.toml")
    stroked = _names(args, "smooth")[0] if args.smooth is not None else CHECKED_OBJECT
    with (
        AudioInput(options.settings_of(args), stroked) as audio,
        console.single_keys() as has_keyboard,
        output.live_display() as live,
    ):
        wait = has_keyboard and not (args.yes or audio.simulated)
        blocks, meters, screen = iter(audio), Meters(audio.source.channels, math.nan), GuideScreen(live, wait)
        parts = [
            record_step(audio, blocks, act, instruction, meters=meters, screen=screen, wait=wait)
            for act, instruction in CHECK_STEPS
        ]
        made = datetime.datetime.now().isoformat(timespec="seconds")
        sounds = CalibrationSounds(audio.source.sample_rate, *parts)
        diagnosis = measure_calibration(sounds, made=made, source=audio.name, false_alarms_per_minute=rate)
    if diagnosis.passed:
        diagnosis.calibration.write(path)
    values = {"passed": diagnosis.passed, "findings": diagnosis.findings, "gain_db": diagnosis.gain_db}
    output.show(values | asdict(diagnosis.calibration), _checked(diagnosis, path), as_json=args.json)
    return 0 if diagnosis.passed else 1


def _estimate(fit: "SetUpFit") -> str:
    after = fit.balanced_accuracy
    if math.isnan(after):
        return "one object of a kind: no estimate; name two smooth and two rough objects to have one"
    if after < 0.75:
        words = "the wrong way round: check which objects are smooth" if after < 0.25 else "little better than chance"
        return (
            f"{words}; check the tip that you named, and add objects; if neither helps, no shipped model fits this "
            "finger: `tactophone record` six objects or more, then `tactophone train --recipe texture`"
        )
    if fit.keeps:
        return f"the shipped boundary stays, right on {output.percent(after)} of this sound over both kinds"
    return f"right on {output.percent(after)} of what it was not fitted to, over both kinds"
