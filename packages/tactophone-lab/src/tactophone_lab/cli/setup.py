"""``tactophone setup``: fit a detector to a new finger, guided, in two minutes; or
compare two objects."""

import argparse
import math
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, nullcontext
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

from tactophone.cli import console, options, output
from tactophone.cli.check import USUAL
from tactophone.cli.guide import (
    GuidePage,
    GuideScreen,
    Steps,
    add_guidance,
    ask,
    findings_in_words,
)
from tactophone.cli.options import Within
from tactophone.core import extras
from tactophone.core.errors import ConfigError
from tactophone.core.settings import Settings
from tactophone.core.tips import DEFAULT_TIP, TIP_NAMES, tip_picture
from tactophone.signal.perception.model_file import read_model
from tactophone.signal.perception.models import default_model, model_path
from tactophone_lab.app.compare_objects import compare_objects, record_two
from tactophone_lab.app.object_sounds import SLIDE, ObjectSounds
from tactophone_lab.app.setup import (
    ROUGH,
    SMOOTH,
    Fitted,
    SetUpSounds,
    check_kind,
    fit_finger,
    record_set_up,
)
from tactophone_lab.cli.comparison import (
    comparison_as_json,
    comparison_in_words,
    two_names,
    verdict,
)

if TYPE_CHECKING:
    from tactophone_lab.training.finger_fit import SetUpFit

QUESTION = (
    "Which tip touches?  Ink it, press it on glass as hard as you will slide, "
    "and look at the mark."
)

UNSURE = "unsure"
"""Answer of whoever does not know the tip: the setting decides, and the fit says where
it does not suit."""

EXAMPLES = (
    "tactophone setup --smooth 'glass,planed wood' --rough 'brick,slate'",
    "tactophone setup --seconds 20 --out mine.onnx",
    "tactophone setup --compare slate,glass",
)


def _fitted(result: Fitted) -> Iterator[output.Part]:
    fit = result.fit
    start = result.start
    before = fit.balanced_accuracy_before
    after = fit.balanced_accuracy
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
        yield (
            f"{unknown} of this sound is unlike all that {start} was trained on: the "
            "new model never abstains"
        )
    if fit.keeps:
        yield (
            f"the boundary of {start} fits your objects and was kept; your tip and "
            "threshold are saved"
        )
    yield (
        f"tip {result.tip}; contact from {result.threshold_dbfs:.1f} dBFS; score: "
        f"{fit.score}"
    )
    if not after >= 0.75:  # also where it is NaN
        yield output.styled("yellow", "note:", f" {_estimate(fit)}")
    tip = "" if result.tip == DEFAULT_TIP else f"--tip {result.tip} "
    yield output.styled(
        "green",
        "written:",
        f" {result.file!s}; use it as {tip}--model of `feel` and `receive`",
    )


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    add(
        "--out",
        type=Path,
        metavar="FILE",
        default=Path("finger.onnx"),
        help="model file to write (default: %(default)s)",
    )
    add(
        "--model",
        default="",
        metavar="NAME|FILE",
        help="texture model to start from (default: the shipped one for the tip)",
    )
    for label, names in (("smooth", SMOOTH), ("rough", ROUGH)):
        words = (
            f"{label} objects of your own, separated by commas; two or more, as "
            "unlike as you have (default: "
            f"your first and second; of the simulated finger {', '.join(names)})"
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
        "--compare",
        metavar="FIRST,SECOND",
        nargs="?",
        const="",
        help="fit nothing: stroke two objects, and see which is rougher and how sure "
        "that is",
    )
    add_guidance(parser)
    options.add_settings(parser, "setup")
    options.add_finger(parser)


def _settings(args: argparse.Namespace) -> Settings:
    return options.settings_of(args, () if args.settings else USUAL)


def run(args: argparse.Namespace) -> int:
    return _fit(args) if args.compare is None else _compare(args)


def _fit(args: argparse.Namespace) -> int:
    extras.require_extras("train")
    output.refuse_unwritable(args.out)
    settings = _settings(args)
    simulated = settings.capture.source.startswith("finger")
    smooth = names_of(args, "smooth", simulated=simulated)
    rough = names_of(args, "rough", simulated=simulated)
    slides = [
        *(_with_label(name, "smooth") for name in smooth),
        *(_with_label(name, "rough") for name in rough),
    ]
    with _guided(args, slides) as screen:
        tip = ask_tip(args, screen)
        check_kind(args.model or default_model(tip))
        with _steps(args, screen) as steps:
            sounds = record_set_up(
                settings,
                smooth,
                rough,
                seconds=args.seconds,
                step=steps,
                begin=steps.begin,
            )
        return _fit_and_write(args, sounds, tip, screen)


@contextmanager
def _guided(args: argparse.Namespace, slides: Sequence[str]) -> Iterator[GuideScreen]:
    """Open the terminal's keys and the page, where one is asked for, for these
    objects."""
    page = GuidePage(wait=not args.yes) if args.dashboard else None
    with console.single_keys() as has_keyboard, page or nullcontext():
        yield GuideScreen(None, has_keyboard, page, steps=("tip", "silence", *slides))


@contextmanager
def _steps(args: argparse.Namespace, screen: GuideScreen) -> Iterator[Steps]:
    """Yield what guides through the recordings, on a live display."""
    with output.live_display() as live:
        yield Steps(replace(screen, live=live), unattended=args.yes)


def _refused(
    args: argparse.Namespace, sounds: ObjectSounds, screen: GuideScreen, words: str
) -> bool:
    """Show what is wrong with the microphones; return whether that is fatal, and then
    say so in these words."""
    findings = sounds.findings()
    refused = any(finding.fatal for finding in findings)
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
    return refused


def _fit_and_write(
    args: argparse.Namespace, sounds: SetUpSounds, tip: str, screen: GuideScreen
) -> int:
    words = "nothing was written: correct what is refused above, and run setup again"
    if _refused(args, sounds.recorded, screen, words):
        return 1
    file = args.out
    with output.progress("fitting", len(sounds.rough)) as update:
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


def _compare(args: argparse.Namespace) -> int:
    if args.smooth or args.rough:
        raise ConfigError(
            "--compare takes two objects, whatever they are: leave out --smooth and "
            "--rough"
        )
    settings = _settings(args)
    simulated = settings.capture.source.startswith("finger")
    usual = (SMOOTH[0], ROUGH[0]) if simulated else ("the first object", "the second")
    first, second = names = two_names(args.compare, usual)
    with _guided(args, names) as screen:
        tip = ask_tip(args, screen)
        read_model(model_path(args.model or default_model(tip)))
        with _steps(args, screen) as steps:
            sounds = record_two(
                settings,
                first,
                second,
                seconds=args.seconds,
                step=steps,
                begin=steps.begin,
            )
        words = "nothing was compared: correct what is refused above, and compare again"
        if _refused(args, sounds, screen, words):
            return 1
        found = compare_objects(sounds, tip=tip, model=args.model)
        output.show(
            comparison_as_json(found, names),
            comparison_in_words(found, names),
            as_json=args.json,
        )
        if screen.page is not None:
            screen.page.show(instruction=verdict(found, names))
    return 0


def names_of(args: argparse.Namespace, label: str, *, simulated: bool) -> list[str]:
    """Return the objects of a label: as named, or the simulated finger's, or the two
    that their owner chooses, whatever they are."""
    given = getattr(args, label)
    usual = {"smooth": SMOOTH, "rough": ROUGH}[label]
    if not simulated:
        usual = (f"your first {label} object", f"your second {label} object")
    names = (
        list(usual)
        if given is None
        else [name.strip() for name in given.split(",") if name.strip()]
    )
    if not names:
        raise ConfigError(
            f"--{label}: name a {label} object at least, such as --{label} "
            f"'{', '.join(SMOOTH)}'"
        )
    return names


def _with_label(name: str, label: str) -> str:
    return name if label in name.split() else f"{name} ({label})"


def ask_tip(args: argparse.Namespace, screen: GuideScreen) -> str:
    """Show the picture and read the answer; the setting where nobody is asked."""
    tip = _settings(args).capture.tip
    if args.yes or not screen.answers:
        return tip
    keys = f"press 1 to {len(TIP_NAMES)}, or any other key for {tip}"
    key = ask(
        screen,
        QUESTION,
        {name: name for name in TIP_NAMES} | {UNSURE: f"Not sure: take {tip}"},
        f"{QUESTION}\n\n{tip_picture()}\n\n{keys}",
    )
    return (
        key
        if key in TIP_NAMES
        else dict(zip("123456789", TIP_NAMES, strict=False)).get(key, tip)
    )


def _estimate(fit: "SetUpFit") -> str:
    after = fit.balanced_accuracy
    if math.isnan(after):
        return (
            "one object of a kind: no estimate; name two smooth and two rough "
            "objects to have one"
        )
    if after < 0.75:
        words = (
            "the wrong way round: check which objects are smooth"
            if after < 0.25
            else "little better than chance"
        )
        return (
            f"{words}; check the tip that you named, and add objects; if neither "
            "helps, no shipped model fits this "
            "finger: `tactophone record` six objects or more, then `tactophone train "
            "--recipe texture`"
        )
    if fit.keeps:
        return (
            f"the shipped boundary stays, right on {output.percent(after)} of this "
            "sound over both kinds"
        )
    return (
        f"right on {output.percent(after)} of what it was not fitted to, over both "
        "kinds"
    )
