"""``tactophone replay``: a recorded run, computed again from its packets in virtual time."""

import argparse
from collections.abc import Callable, Iterator
from dataclasses import asdict, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tactophone.cli import options, output, page
from tactophone.core import extras
from tactophone.core.errors import ConfigError
from tactophone.core.settings import DEFAULT_CEILING, Finger, Settings, change

if TYPE_CHECKING:
    from tactophone.app.replay import RenderedFinger, Replay
    from tactophone.live.log.mcap import LogEntry

CHANGES = ("detector.model", "rendering.profile", "rendering.ceiling")
"""What may differ from the run that was logged."""

EXAMPLES = (
    "tactophone replay run.mcap",
    "tactophone replay run.mcap --out again --profile lra --plot",
    "tactophone replay run.mcap --to-rosbag bag",
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    add("log", type=Path, metavar="LOG", help="MCAP file written by --record")
    add("--out", type=Path, metavar="DIR", help="folder for vibration and timeline, as from `feel`; none by default")
    for name in CHANGES:
        options.add_flag(parser, name, "")
    options.add_figure(parser, ", in --out")
    add("--to-rosbag", type=Path, metavar="DIR", help="write a ROS 2 bag to a new folder: sound, predictions, commands")
    add("--audio", type=Path, metavar="FILE.mcap", help="copy the log and add its sound, for Foxglove to play")
    options.add_json(parser, "print the comparison as JSON")
    page.add_dashboard(parser, "replay")


def run(args: argparse.Namespace) -> int:
    """Compute the run again; exit 1 if nothing was changed and a prediction or command differs from the log."""
    from tactophone.app.replay import Replay
    from tactophone.live.log.mcap import read_log

    if args.to_rosbag:
        extras.require_modules("cyclonedds", "rosbags")
        if args.out:
            raise ConfigError("--to-rosbag writes no other files: leave --out away, or call replay twice")
    if args.plot and args.out is None:
        raise ConfigError("--plot needs a folder for its file: add --out DIR")
    changes = [f"{name}={value}" for name in CHANGES if (value := vars(args)[name]) is not None]

    def changed(settings: Settings) -> Settings:
        common, names = change(settings, changes), [text.partition("=")[0] for text in changes]
        # What is chosen here holds for every finger, also for those with a model, profile or ceiling of their own.
        fingers = (
            Finger(each.name, tuple(own for own in each.settings if own[0] not in names)) for each in settings.fingers
        )
        return replace(common, fingers=tuple(fingers))

    # A log is compared at its own ceiling; what is written and felt keeps to this machine's.
    ceiling = DEFAULT_CEILING if vars(args)["rendering.ceiling"] is None else 1.0
    written = args.to_rosbag or args.out
    replay = Replay(_with_progress(args.log, read_log(args.log)), changed, ceiling if written else 1.0)
    files: dict[str, Path] = {}
    rendered: list[RenderedFinger] = []
    if args.to_rosbag:
        _write_bag(replay, args, files)
    elif args.out is None:
        for _ in replay.steps():
            pass
    else:
        rendered = _write(replay, args, files)
    if replay.lowered:
        replay = Replay(read_log(args.log), changed)
        for _ in replay.steps():
            pass
        replay.notes.append(
            f"the ceiling of the run was above {ceiling:g}, to which what is written is bounded: --ceiling raises that"
        )
    if args.audio:
        from tactophone.app.replay import add_sound

        files["audio"] = add_sound(args.log, args.audio)
    values = _values(args.log, replay, rendered, files)
    output.show(values, _parts(replay, files, changed=bool(changes)), as_json=args.json)
    own = options.settings_of(args)
    if page.wanted(args, own):
        _play(args.log, own, changed, ceiling)
    return 1 if replay.comparison.different and not changes else 0


def _with_progress(path: Path, entries: "Iterator[LogEntry]") -> "Iterator[LogEntry]":
    with output.progress("replaying", note=path.name):
        yield from entries


def _write(replay: "Replay", args: argparse.Namespace, files: dict[str, Path]) -> "list[RenderedFinger]":
    from tactophone.app.replay import write_replay

    rendered = write_replay(replay, args.out, args.log.stem, plot=args.plot)
    for finger in rendered:
        of = f"{finger.name} " * bool(finger.name)
        files.update({f"{of}{kind}": path for kind, path in finger.files.items()})
    return rendered


def _write_bag(replay: "Replay", args: argparse.Namespace, files: dict[str, Path]) -> None:
    """Write the steps as a bag whose time begins when the run did."""
    from tactophone.faces.bridges.ros import RosBag
    from tactophone.live.log.mcap import read_log
    from tactophone.live.telemetry.records import EventBatch, RunStart

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


def _play(log: Path, own: Settings, change: Callable[[Settings], Settings], ceiling: float) -> None:
    """Play the sound of the log on the page, through a pipeline with the settings and calibration of the replay."""
    from tempfile import TemporaryDirectory

    from tactophone.app.playback import Take
    from tactophone.app.replay import LoggedEndpoint, write_sound
    from tactophone.core.hand import names_of
    from tactophone.live.audio.files import FileSource
    from tactophone.live.log.mcap import read_log
    from tactophone.live.telemetry.records import RunStart

    run = next(entry for entry in read_log(log) if isinstance(entry, RunStart))
    with TemporaryDirectory(prefix="tactophone-") as folder:
        endpoint = LoggedEndpoint(run, change, ceiling=ceiling)
        sounds, takes = write_sound(log, Path(folder)), []
        for number in dict.fromkeys(sound.session for sound in sounds):
            paths = [sound.path for sound in sounds if sound.session == number]
            pipelines = [endpoint.open(FileSource(path).channels, finger=finger) for finger, path in enumerate(paths)]
            names = names_of(endpoint.settings)
            takes.append(Take(log.name, paths, pipelines, fingers=names))
        page.play_on_page(own, takes, name="replay")


def _values(log: Path, replay: "Replay", rendered: "list[RenderedFinger]", files: dict[str, Path]) -> dict[str, Any]:
    # The summary of the only finger, or of each by its name.
    of = {finger.name: asdict(finger.summary) for finger in rendered}
    compared = {name: getattr(replay.comparison, name) for name in ("equal", "different", "uncertain")}
    of_run = {name: getattr(replay, name) for name in ("role", "processes", "complete", "missed", "notes")}
    return {"log": log, **of_run, **compared, "files": files, **({"summary": of.get("", of)} if of else {})}


def _parts(replay: "Replay", files: dict[str, Path], *, changed: bool) -> Iterator[output.Part]:
    comparison = replay.comparison
    total = comparison.equal + comparison.different
    if replay.role == "robot":
        yield "the robot's side: its packets computed as an operator without losses would; nothing to compare with"
    elif changed:
        yield f"{comparison.different} of {total} predictions or commands differ from those logged"
    elif comparison.different:
        yield f"{comparison.different} of {total} predictions or commands differ from those logged; the first:"
        for name, entry in zip(("logged", "computed"), comparison.first or (), strict=False):
            yield f"  {name:9}{entry.prediction} {entry.command}"
    else:
        yield f"{comparison.equal} predictions and commands, equal to the bit to those logged"
    if comparison.uncertain:
        yield f"{comparison.uncertain} were made while a control changed, and are not compared"
    if not replay.complete:
        yield "the log has no end: its writer was killed or its disk was full; read to its last part"
    if replay.missed:
        yield f"the recorder missed {replay.missed} bytes or predictions on a busy machine"
    for note in replay.notes:
        yield f"! {note}"
    for kind, path in files.items():
        yield f"{kind + ':':11}{' ' * (len(kind) > 9)}{path}"
