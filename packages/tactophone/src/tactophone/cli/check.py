"""``tactophone check``: whether the microphones work, and from which level there is
contact."""

import argparse
import math
from collections.abc import Iterator
from contextlib import nullcontext
from dataclasses import asdict, replace
from pathlib import Path

from tactophone.app.check import CHECKED_OBJECT, check_microphones
from tactophone.app.sources import UNATTENDED
from tactophone.cli import console, options, output
from tactophone.cli.guide import (
    GuidePage,
    GuideScreen,
    Steps,
    add_guidance,
    ask,
    findings_in_words,
)
from tactophone.core.microphones import MICROPHONES
from tactophone.signal.perception.calibration import CalibrationResult

ROBOT_QUESTION = "Does a robot move this finger?"

USUAL = ("simulation.gain_db=-20",)
"""At 0 dB the simulated finger clips on rough objects, which is refused; a settings
file has its own."""

EXAMPLES = (
    "tactophone check",
    "tactophone check --out calibration.toml --false-alarms 0.5/min",
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    add(
        "--out",
        type=Path,
        metavar="FILE",
        default=Path("calibration.toml"),
        help="calibration file to write (default: %(default)s)",
    )
    add(
        "--stroked",
        metavar="NAME",
        default=CHECKED_OBJECT,
        help="with --source finger: the object that the simulated finger strokes "
        "(default: %(default)s)",
    )
    add(
        "--false-alarms",
        default="1/min",
        metavar="N/min",
        help="false contacts to allow in silence, over 0 to 600 a minute "
        "(default: %(default)s)",
    )
    add_guidance(parser)
    options.add_settings(parser, "check")
    options.add_finger(parser)


def run(args: argparse.Namespace) -> int:
    settings = options.settings_of(args, () if args.settings else USUAL)
    rate = options.per_minute(args.false_alarms)
    path = args.out
    output.refuse_unwritable(path)
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
                ask(screen, ROBOT_QUESTION, {"y": "Yes", "n": "No, a hand does"}, words)
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
                stroked=args.stroked,
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
                findings=[str(finding) for finding in found.findings], instruction=words
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


def _checked(found: CalibrationResult, file: Path) -> Iterator[output.Part]:
    calibration = found.calibration
    gains = found.gain_db
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
    rate = calibration.false_alarms_per_minute
    yield (
        f"contact from {calibration.threshold_dbfs:.1f} dBFS (a window of 256 ms: "
        f"{calibration.window_dbfs:.1f} dBFS): at most "
        f"{rate:g} false {'contact' if rate == 1 else 'contacts'} a minute"
    )
    if not math.isnan(found.motion_db):
        yield (
            f"motion: {found.motion_db:.1f} dB over rest under 500 Hz; fainter touches "
            f"are missed while it lasts. Bands count from {calibration.margin_db:g} dB "
            "over noise (--set detector.margin_db=5 overrules that)"
        )
    yield from findings_in_words(found.findings)
    if found.passed:
        name = str(file)
        yield output.styled(
            "green",
            "good:",
            f" written to {name}; use it as --calibration of `record`, `train` and "
            "`receive`",
        )
    else:
        yield "nothing was written: correct what is refused above, and check again"
