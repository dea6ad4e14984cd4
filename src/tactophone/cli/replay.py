"""``tactophone replay``: a recorded run, computed again from its packets in virtual time."""

import argparse
from collections.abc import Iterator
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tactophone.cli._support import dashboard_options, extras, haptic_file_option, terminal
from tactophone.cli._support.ranges import CEILING
from tactophone.errors import ConfigError
from tactophone.settings import Finger, Settings, change

if TYPE_CHECKING:
    from tactophone.bridges import LogEntry
    from tactophone.offline.replay import RenderedFinger, Replay

CHANGES = {"model": "detector.model", "profile": "rendering.profile", "ceiling": "rendering.ceiling"}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the verb's arguments."""
    add = parser.add_argument
    add("log", type=Path, metavar="LOG", help="MCAP file written by --record")
    add("--out", type=Path, metavar="DIR", help="folder for vibration and timeline, as from `feel`; none by default")
    add("--model", metavar="NAME|FILE", help="compute with another model")
    add("--profile", metavar="NAME", help="compute with another rendering profile")
    add("--ceiling", type=CEILING, metavar="LEVEL", help="compute with another ceiling, %(type)s")
    add("--plot", action="store_true", help="draw a figure of sound, prediction and vibration, in --out")
    haptic_file_option.add_arguments(parser)
    add("--to-rosbag", type=Path, metavar="DIR", help="write a ROS 2 bag to a new folder: sound, predictions, commands")
    add("--audio", type=Path, metavar="FILE.mcap", help="copy the log and add its sound, for Foxglove to play")
    add("--json", action="store_true", help="print the comparison as JSON")
    dashboard_options.add_arguments(parser)


def run(args: argparse.Namespace) -> int:
    """Compute the run again; exit 1 if nothing was changed and a prediction or command differs from the log."""
    from tactophone.bridges import read_log
    from tactophone.offline.replay import Replay

    if args.to_rosbag:
        extras.require_modules("cyclonedds", "rosbags")
        if args.out:
            raise ConfigError("--to-rosbag writes no other files: leave --out away, or call replay twice")
    if (args.plot or args.to) and args.out is None:
        raise ConfigError("--plot and --to need a folder for their files: add --out DIR")
    changes = [f"{name}={value}" for option, name in CHANGES.items() if (value := getattr(args, option)) is not None]

    def changed(settings: Settings) -> Settings:
        common, names = change(settings, changes), [text.partition("=")[0] for text in changes]
        # What is chosen here holds for every finger, also for those with a model, profile or ceiling of their own.
        fingers = (
            Finger(each.name, tuple(own for own in each.settings if own[0] not in names)) for each in settings.fingers
        )
        return replace(common, fingers=tuple(fingers))

    replay = Replay(_with_progress(args.log, read_log(args.log)), changed)
    files: dict[str, Path] = {}
    rendered: list[RenderedFinger] = []
    if args.to_rosbag:
        _write_bag(replay, args, files)
    elif args.out is None:
        for _ in replay.steps():
            pass
    else:
        rendered = _write(replay, args, files)
    if args.audio:
        from tactophone.offline.replay import add_sound

        files["audio"] = add_sound(args.log, args.audio)
    _print(args, replay, rendered, files, changed=bool(changes))
    if dashboard_options.wanted(args):
        _show(args, changed)
    return 1 if replay.comparison.different and not changes else 0


def _with_progress(path: Path, entries: "Iterator[LogEntry]") -> "Iterator[LogEntry]":
    with terminal.progress("replaying", note=path.name):
        yield from entries


def _write(replay: "Replay", args: argparse.Namespace, files: dict[str, Path]) -> "list[RenderedFinger]":
    from tactophone.offline.replay import write_replay

    rendered = write_replay(replay, args.out, args.log.stem, plot=args.plot)
    for finger in rendered:
        written, of = finger.files, f"{finger.name} " * bool(finger.name)
        stem = args.out / "-".join(filter(None, (args.log.stem, finger.name)))
        written |= haptic_file_option.write(args, stem, written["timeline"], duration=finger.summary.duration)
        files.update({f"{of}{kind}": path for kind, path in written.items()})
    return rendered


def _write_bag(replay: "Replay", args: argparse.Namespace, files: dict[str, Path]) -> None:
    """Write the steps as a bag whose time begins when the run did."""
    from tactophone.bridges import read_log
    from tactophone.bridges.ros import RosBag
    from tactophone.telemetry import EventBatch, RunStart

    epoch, begun, names = 0.0, 0.0, ["index"]
    for entry in read_log(args.log):
        if isinstance(entry, RunStart):
            epoch = entry.epoch
            names = [finger["name"] or "index" for finger in entry.fingers]
        elif isinstance(entry, EventBatch):
            begun = entry.time
            break
    with RosBag(args.to_rosbag, epoch=epoch + begun, fingers=names) as bag:
        for step in replay.steps():
            bag.write(step)
    files["bag"] = args.to_rosbag


def _show(args: argparse.Namespace, change: Any) -> None:
    """Play the sound of the log on the page, through a pipeline with the settings and calibration of the replay."""
    from tempfile import TemporaryDirectory

    from tactophone.bridges import read_log
    from tactophone.capture import FileSource
    from tactophone.cli._support import recording_playback
    from tactophone.hand import names_of
    from tactophone.offline.replay import LoggedEndpoint, write_sound
    from tactophone.telemetry import RunStart

    run = next(entry for entry in read_log(args.log) if isinstance(entry, RunStart))
    with TemporaryDirectory(prefix="tactophone-") as folder:
        endpoint = LoggedEndpoint(run, change)
        sounds, takes = write_sound(args.log, Path(folder)), []
        for number in dict.fromkeys(sound.session for sound in sounds):
            paths = [sound.path for sound in sounds if sound.session == number]
            pipelines = [endpoint.open(FileSource(path).channels, finger=finger) for finger, path in enumerate(paths)]
            names = names_of(endpoint.settings)
            takes.append(recording_playback.Take(args.log.name, paths, pipelines, fingers=names))
        recording_playback.play_on_page(args, takes, name="replay")


def _print(
    args: argparse.Namespace,
    replay: "Replay",
    rendered: "list[RenderedFinger]",
    files: dict[str, Path],
    *,
    changed: bool,
) -> None:
    comparison = replay.comparison
    if args.json:
        entries = {
            "log": str(args.log), "role": replay.role, "processes": replay.processes, "complete": replay.complete,
            "missed": replay.missed, "equal": comparison.equal, "different": comparison.different,
            "uncertain": comparison.uncertain, "notes": replay.notes,
            "files": {kind: str(path) for kind, path in files.items()},
            **_summaries(rendered),
        }  # fmt: skip
        terminal.print_json(entries)
        return
    total = comparison.equal + comparison.different
    if replay.role == "robot":
        print("the robot's side: its packets computed as an operator without losses would; nothing to compare with")
    elif changed:
        print(f"{comparison.different} of {total} predictions or commands differ from those logged")
    elif comparison.different:
        print(f"{comparison.different} of {total} predictions or commands differ from those logged; the first:")
        for name, entry in zip(("logged", "computed"), comparison.first or (), strict=False):
            print(f"  {name:9}{entry.prediction} {entry.command}")
    else:
        print(f"{comparison.equal} predictions and commands, equal to the bit to those logged")
    if comparison.uncertain:
        print(f"{comparison.uncertain} were made while a control changed, and are not compared")
    if not replay.complete:
        print("the log has no end: its writer was killed or its disk was full; read to its last part")
    if replay.missed:
        print(f"the recorder missed {replay.missed} bytes or predictions on a busy machine")
    for note in replay.notes:
        print(f"! {note}")
    for kind, path in files.items():
        print(f"{kind + ':':11}{' ' * (len(kind) > 9)}{path}")


def _summaries(rendered: "list[RenderedFinger]") -> dict[str, Any]:
    """Return the summary of the only finger, or of each by its name."""
    of = {finger.name: asdict(finger.summary) for finger in rendered}
    return {"summary": of.get("", of)} if of else {}
