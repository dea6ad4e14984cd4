"""``tactophone setup``: fit a detector to a new finger, guided, in two minutes; or
check its microphones."""

import argparse
import math
from collections.abc import Iterator, Sequence
from contextlib import nullcontext
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING

from tactophone.app.setup import (
    CHECKED_OBJECT,
    ROUGH,
    SLIDE,
    SMOOTH,
    Fitted,
    SetUpSounds,
    check_kind,
    check_microphones,
    fit_finger,
    record_set_up,
)
from tactophone.app.sources import UNATTENDED, AudioInput
from tactophone.cli import console, options, output
from tactophone.cli.guide import GuidePage, GuideScreen, Meters, record_step
from tactophone.cli.options import Within
from tactophone.core.errors import ConfigError
from tactophone.core.microphones import MICROPHONES
from tactophone.core.settings import Settings
from tactophone.core.tips import DEFAULT_TIP, TIP_NAMES, tip_picture
from tactophone.core.types import AudioBlock, FloatArray
from tactophone.signal.perception.calibration import CalibrationResult, Finding
from tactophone.signal.perception.models import default_model

if TYPE_CHECKING:
    from tactophone.app.sources import SimulatedAct
    from tactophone.lab.training.setup import SetUpFit

QUESTION = "Which tip touches?  Ink it, press it on glass as hard as you will slide, and look at the mark."

ROBOT_QUESTION = "Does a robot move this finger?"

USUAL = ("simulation.gain_db=-20",)
"""At 0 dB the simulated finger clips on rough objects, which is refused; a settings
file has its own."""

EXAMPLES = (
    "tactophone setup --smooth 'glass,planed wood' --rough 'brick,slate'",
    "tactophone setup --check --out calibration.toml",
)


def _fitted(result: Fitted) -> Iterator[output.Part]:
    fit, start = result.fit, result.start
    before, after = fit.balanced_accuracy_before, fit.balanced_accuracy
    yield from findings_in_words(result.findings)
    rows = [
        (e.name, "rough" if e.rough else "smooth", e.before, e.after)
        for e in fit.left_out
    ]
    yield [
        {
            "object": name,
            "is": kind,
            f"right, {start} as it ships": output.percent(shipped),
            "right, left out of the fit": output.percent(own),
        }
        for name, kind, shipped, own in [
            *rows,
            (output.styled("bold", "balanced"), "", before, after),
        ]
    ]
    if not fit.abstains:
        unknown = output.percent(fit.unknown)
        yield f"{unknown} of this sound is unknown to {start}: the new model never abstains"
    if fit.keeps:
        yield f"the boundary of {start} fits your objects and was kept; your tip and threshold are saved"
    yield f"tip {result.tip}; contact from {result.threshold_dbfs:.1f} dBFS; score: {fit.score}"
    if not after >= 0.75:  # also where it is NaN
        yield output.styled("yellow", "note:", f" {_estimate(fit)}")
    tip = "" if result.tip == DEFAULT_TIP else f"--tip {result.tip} "
    yield output.styled(
        "green",
        "written:",
        f" {result.file!s}; use it as {tip}--model of `feel` and `receive`",
    )


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
    if not math.isnan(found.motion_db):
        yield (
            f"motion: {found.motion_db:.1f} dB over rest under 500 Hz; fainter touches are missed while it lasts. "
            f"Bands count from {calibration.margin_db:g} dB over noise (--set detector.margin_db=5 overrules that)"
        )
    yield from findings_in_words(found.findings)
    if found.passed:
        name = str(file)
        yield output.styled(
            "green",
            "good:",
            f" written to {name}; use it as --calibration of `record`, `train` and `receive`",
        )
    else:
        yield "nothing was written: correct what is refused above, and check again"


def findings_in_words(findings: Sequence[Finding]) -> Iterator[output.Part]:
    for finding in findings:
        style, word = ("red", "refused:") if finding.fatal else ("yellow", "note:")
        yield output.styled(style, word, f" {finding}")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    add(
        "--out",
        type=Path,
        metavar="FILE",
        help="file to write (default: finger.onnx; with --check calibration.toml)",
    )
    add(
        "--model",
        default="",
        metavar="NAME|FILE",
        help="texture model to start from (default: the shipped one for the tip)",
    )
    for label, names in (("smooth", SMOOTH), ("rough", ROUGH)):
        words = (
            f"{label} objects of your own, separated by commas; two or more, as unlike as you have (default: "
            f"{', '.join(names)})"
        )
        add(f"--{label}", metavar="NAMES", help=words)
    add(
        "--seconds",
        type=Within(float, 2, 60, unit="s"),
        default=SLIDE,
        metavar="S",
        help="time to slide on each object, %(type)s",
    )
    add(
        "--yes",
        action="store_true",
        help="ask nothing, and start each step without a key press",
    )
    options.add_json(parser, "print the result as JSON")
    add(
        "--dashboard",
        action="store_true",
        help="guide on a page of this machine too, and print its address",
    )
    words = (
        "only check the microphones and measure noise floor and contact threshold: silence, strokes, taps, and a "
        "robot's motion; writes a calibration file, by default calibration.toml"
    )
    add("--check", action="store_true", help=words)
    add(
        "--false-alarms",
        default="1/min",
        metavar="N/min",
        help="with --check: false contacts to allow in silence, over 0 to 600 a minute",
    )
    options.add_settings(parser, "setup")
    options.add_finger(parser)


class Steps:
    """Shows each step on the terminal and the page; a person starts it, unless
    ``unattended``."""

    def __init__(self, screen: GuideScreen, *, unattended: bool) -> None:
        self._screen, self._unattended = screen, unattended

    def begin(self, number: int, audio: AudioInput) -> None:
        """Mark a step as the one now; of the first, open the meters."""
        if number == 1:
            self._meters = Meters(audio.source.channels, math.nan)
            self._wait = self._screen.answers and not (
                self._unattended or audio.simulated
            )
        self._screen.begin(number)

    def __call__(
        self,
        audio: AudioInput,
        blocks: Iterator[AudioBlock],
        act: "SimulatedAct",
        instruction: str,
    ) -> FloatArray:
        return record_step(
            audio,
            blocks,
            act,
            instruction,
            meters=self._meters,
            screen=self._screen,
            wait=self._wait,
        )


def _settings(args: argparse.Namespace) -> Settings:
    return options.settings_of(args, () if args.settings else USUAL)


def run(args: argparse.Namespace) -> int:
    settings = _settings(args)
    if args.check:
        return _check_set_up(args)
    file = args.out or Path("finger.onnx")
    smooth, rough = _names(args, "smooth"), _names(args, "rough")
    page = GuidePage(wait=not args.yes) if args.dashboard else None
    with console.single_keys() as has_keyboard, page or nullcontext():
        slides = [
            *(f"{name} (smooth)" for name in smooth),
            *(f"{name} (rough)" for name in rough),
        ]
        screen = GuideScreen(
            None, has_keyboard, page, steps=("tip", "silence", *slides)
        )
        tip = _ask_tip(args, screen)
        with output.live_display() as live:
            steps = Steps(replace(screen, live=live), unattended=args.yes)
            sounds = record_set_up(
                settings,
                smooth,
                rough,
                seconds=args.seconds,
                step=steps,
                begin=steps.begin,
            )
        return _fit_and_write(args, file, sounds, tip, screen)


def _fit_and_write(
    args: argparse.Namespace,
    file: Path,
    sounds: SetUpSounds,
    tip: str,
    screen: GuideScreen,
) -> int:
    check_kind(args.model or default_model(tip))
    findings = sounds.findings()
    refused = any(finding.fatal for finding in findings)
    words = "nothing was written: correct what is refused above, and run setup again"
    if screen.page is not None:
        screen.page.show(
            findings=[str(each) for each in findings],
            **({"instruction": words} if refused else {}),
        )
    if refused:
        messages = [finding.message for finding in findings]
        output.show(
            {"passed": False, "findings": messages},
            [*findings_in_words(findings), words],
            as_json=args.json,
        )
        return 1
    with output.progress("fitting", len(sounds.objects)) as update:
        result = fit_finger(
            sounds,
            file,
            tip=tip,
            model=args.model,
            report=lambda done: update(completed=done),
        )
    output.show(result, _fitted(result), as_json=args.json)
    if screen.page is not None:
        content = output.finite(output.as_values(result))
        words = f"Written: {file}; {_estimate(result.fit)}. Now feel with it:"
        screen.page.show(
            result=content
            | {"words": words, "command": f"tactophone receive --model {file}"}
        )
    return 0


def _names(args: argparse.Namespace, label: str) -> list[str]:
    given, usual = getattr(args, label), {"smooth": SMOOTH, "rough": ROUGH}[label]
    names = (
        list(usual)
        if given is None
        else [name.strip() for name in given.split(",") if name.strip()]
    )
    if not names:
        raise ConfigError(
            f"--{label}: name a {label} object at least, such as --{label} '{', '.join(SMOOTH)}'"
        )
    return names


def _ask_tip(args: argparse.Namespace, screen: GuideScreen) -> str:
    """Show the picture and read the answer; the setting where nobody is asked."""
    tip = _settings(args).capture.tip
    if args.yes or not screen.answers:
        return tip
    keys = f"press 1 to {len(TIP_NAMES)}, or any other key for {tip}"
    key = _ask(
        screen,
        QUESTION,
        {name: name for name in TIP_NAMES},
        f"{QUESTION}\n\n{tip_picture()}\n\n{keys}",
    )
    return (
        key
        if key in TIP_NAMES
        else dict(zip("123456789", TIP_NAMES, strict=False)).get(key, tip)
    )


def _ask(
    screen: GuideScreen, question: str, buttons: dict[str, str], words: str
) -> str:
    """Ask on the page and, in these words, on the terminal; return the button or the
    key that was pressed."""
    output.log().print(words, highlight=False, markup=False)
    if screen.page is not None:
        screen.begin(0)
        screen.page.show(instruction=question, buttons=buttons)
    while not (key := screen.pressed(0.5)):
        pass
    if key in console.QUIT_KEYS:
        raise KeyboardInterrupt
    if screen.page is not None:
        screen.page.show(instruction="Opening the microphones", buttons={})
    return key


def _check_set_up(args: argparse.Namespace) -> int:
    settings = _settings(args)
    rate, path = (
        options.per_minute(args.false_alarms),
        args.out or Path("calibration.toml"),
    )
    stroked = _names(args, "smooth")[0] if args.smooth is not None else CHECKED_OBJECT
    page = GuidePage(wait=not args.yes) if args.dashboard else None
    with console.single_keys() as has_keyboard, page or nullcontext():
        if page is not None:
            page.show(
                title="Check the microphones",
                about="Silence, strokes and taps, and a robot's motion",
            )
        screen = GuideScreen(
            None,
            has_keyboard,
            page,
            steps=("robot", "silence", "stroke", "taps", "motion"),
        )
        moving = (
            not args.yes
            and screen.answers
            and settings.capture.source not in UNATTENDED
        )
        if moving:
            words = f"{ROBOT_QUESTION}  press y, or any other key for no"
            moving = (
                _ask(
                    screen, ROBOT_QUESTION, {"y": "Yes", "n": "No, a hand does"}, words
                )
                == "y"
            )
        with output.live_display() as live:
            steps = Steps(
                replace(screen, live=live, steps=screen.steps[: 4 + moving]),
                unattended=args.yes,
            )
            found = check_microphones(
                settings,
                path,
                stroked=stroked,
                false_alarms_per_minute=rate,
                moving=moving,
                step=steps,
                begin=steps.begin,
            )
        if page is not None:
            words = (
                f"written: {path}"
                if found.passed
                else "nothing was written: correct this, and check again"
            )
            page.show(
                findings=[str(each) for each in found.findings], instruction=words
            )
    values = {
        "passed": found.passed,
        "findings": found.findings,
        "gain_db": found.gain_db,
    }
    values |= {"motion_db": found.motion_db}
    output.show(
        values | asdict(found.calibration), _checked(found, path), as_json=args.json
    )
    return 0 if found.passed else 1


def _estimate(fit: "SetUpFit") -> str:
    after = fit.balanced_accuracy
    if math.isnan(after):
        return "one object of a kind: no estimate; name two smooth and two rough objects to have one"
    if after < 0.75:
        words = (
            "the wrong way round: check which objects are smooth"
            if after < 0.25
            else "little better than chance"
        )
        return (
            f"{words}; check the tip that you named, and add objects; if neither helps, no shipped model fits this "
            "finger: `tactophone record` six objects or more, then `tactophone train --recipe texture`"
        )
    if fit.keeps:
        return f"the shipped boundary stays, right on {output.percent(after)} of this sound over both kinds"
    return f"right on {output.percent(after)} of what it was not fitted to, over both kinds"
