"""``tactophone replay``: a recorded run, computed again from its packets in virtual
time."""

import argparse
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import TYPE_CHECKING, Any

from tactophone.cli import options, output, page
from tactophone.core import extras
from tactophone.core.errors import ConfigError

if TYPE_CHECKING:
    from tactophone.app.replay import Replay, ReplayedLog
    from tactophone.live.log.mcap import LogEntry

CHANGES = ("detector.model", "rendering.profile", "rendering.ceiling")
"""What may differ from the run that was logged."""

EXAMPLES = (
    "tactophone replay run.mcap",
    "tactophone replay run.mcap --out again --profile lra --plot",
    "tactophone replay run.mcap --to-rosbag bag",
    "tactophone replay run.mcap --repair finished.mcap",
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    add("log", type=Path, metavar="LOG", help="MCAP file written by --record")
    add(
        "--out",
        type=Path,
        metavar="DIR",
        help="folder for vibration and timeline, as from `feel`; none by default",
    )
    for name in CHANGES:
        options.add_flag(parser, name, "")
    options.add_figure(parser, ", in --out")
    add(
        "--to-rosbag",
        type=Path,
        metavar="DIR",
        help="write a ROS 2 bag to a new folder: sound, predictions, commands",
    )
    add(
        "--audio",
        type=Path,
        metavar="FILE.mcap",
        help="copy the log and add its sound, for Foxglove to play",
    )
    add(
        "--repair",
        type=Path,
        metavar="FILE.mcap",
        help="only copy a log whose recorder was killed, with the index and the end "
        "that other programs ask for",
    )
    options.add_json(parser, "print the comparison as JSON")
    page.add_dashboard(parser, "replay")


def run(args: argparse.Namespace) -> int:
    """Compute the run again; exit 1 if nothing was changed and a prediction or command
    differs from the log."""
    from tactophone.app.logged_run import repair_log
    from tactophone.app.replay import replay_log, takes_of

    if args.repair:
        count = repair_log(args.log, args.repair)
        values = {"log": args.log, "repaired": args.repair, "messages": count}
        words = f"{args.repair}: {count} messages of {args.log}, with index and end"
        output.show(values, [words], as_json=args.json)
        return 0
    if args.to_rosbag:
        extras.require_modules("cyclonedds", "rosbags")
        if args.out:
            raise ConfigError(
                "--to-rosbag writes no other files: leave --out away, or call replay "
                "twice"
            )
    if args.plot and args.out is None:
        raise ConfigError("--plot needs a folder for its file: add --out DIR")
    changes = [
        f"{name}={value}" for name in CHANGES if (value := vars(args)[name]) is not None
    ]

    def follow(entries: "Iterator[LogEntry]") -> "Iterator[LogEntry]":
        with output.progress("replaying", note=args.log.name):
            yield from entries

    with output.as_private_as(args.log):
        replayed = replay_log(
            args.log,
            changes,
            out=args.out,
            bag=args.to_rosbag,
            audio=args.audio,
            plot=args.plot,
            follow=follow,
        )
    parts = _parts(replayed.replay, replayed.files, changed=bool(changes))
    output.show(_values(args.log, replayed), parts, as_json=args.json)
    own = options.settings_of(args)
    if page.wanted(args, own):
        with TemporaryDirectory(prefix="tactophone-") as folder:
            page.play_on_page(
                own, takes_of(args.log, changes, Path(folder)), name="replay"
            )
    return 1 if replayed.replay.comparison.different and not changes else 0


def _values(log: Path, replayed: "ReplayedLog") -> dict[str, Any]:
    replay = replayed.replay
    files = replayed.files
    # The summary of the only finger, or of each by its name.
    of = {finger.name: asdict(finger.summary) for finger in replayed.fingers}
    compared = {
        name: getattr(replay.comparison, name)
        for name in ("equal", "different", "uncertain")
    }
    of_run = {
        name: getattr(replay, name)
        for name in ("role", "processes", "complete", "missed", "notes")
    }
    return {
        "log": log,
        **of_run,
        **compared,
        "files": files,
        **({"summary": of.get("", of)} if of else {}),
    }


def _parts(
    replay: "Replay", files: dict[str, Path], *, changed: bool
) -> Iterator[output.Part]:
    from tactophone.live.log.reader import words_for_missed

    comparison = replay.comparison
    total = comparison.equal + comparison.different
    if replay.role == "robot":
        yield (
            "the robot's side: its packets computed as an operator without losses "
            "would; nothing to compare with"
        )
    elif changed:
        yield (
            f"{comparison.different} of {total} predictions or commands differ from "
            "those logged"
        )
    elif comparison.different:
        yield (
            f"{comparison.different} of {total} predictions or commands differ from "
            "those logged; the first:"
        )
        for name, entry in zip(
            ("logged", "computed"), comparison.first or (), strict=False
        ):
            yield f"  {name:9}{entry.prediction} {entry.command}"
    else:
        yield (
            f"{comparison.equal} predictions and commands, equal to the bit to those "
            "logged"
        )
    if comparison.uncertain:
        yield (
            f"{comparison.uncertain} were made while a control changed, and are not "
            "compared"
        )
    if not replay.complete:
        yield (
            "the log has no end: its writer was killed or its disk was full; read to "
            "its last part"
        )
    if any(replay.missed.values()):
        yield (
            f"the recorder missed {words_for_missed(replay.missed)} on a busy machine"
        )
    for note in replay.notes:
        yield f"! {note}"
    for kind, path in files.items():
        yield f"{kind + ':':11}{' ' * (len(kind) > 9)}{path}"
