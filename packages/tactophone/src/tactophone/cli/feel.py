"""``tactophone feel``: recordings in; the vibration that a finger would feel, and a
timeline of predictions, out."""

import argparse
import shlex
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory

from tactophone.app.feel import Felt, FoundSound, feel, sounds_of, unique_stems
from tactophone.cli import options, output, page
from tactophone.core.errors import TactophoneError
from tactophone.core.recordings.values import CHECKED_SILENT_DBFS
from tactophone.core.settings import Settings
from tactophone.signal.haptics.passthrough import passthrough_names
from tactophone.signal.haptics.profiles import PROFILES
from tactophone.signal.perception.noise_floor import FLOOR_SILENT_DBFS

EXAMPLES = (
    "tactophone feel stroke.wav --plot",
    "tactophone feel recordings/*.flac --out felt --profile lra",
    "tactophone feel run.mcap --finger index --dashboard",
)


def _parts(felt: Felt) -> Iterator[output.Part]:
    """Print the summary; where there was no contact, the likely cause and the next
    command."""
    summary = felt.summary
    label = f"; labelled {felt.label}" if felt.label else ""
    yield output.styled("bold", f"{felt.path!s}", f": {summary.duration:.1f} s{label}")
    for_one_channel = ", for one channel" if felt.chosen_for_mono else ""
    yield f"  model      {felt.pipeline.detector.name}{for_one_channel}"
    if felt.chosen_for_mono:
        yield (
            "  (mono: treated as the contact microphone; for a rod with its own "
            "microphone, pass --tip stylus)"
        )
    shares = (summary.contact, summary.rough, summary.unknown)
    contact, rough, unknown = (
        output.percent(share, unknown="none") for share in shares
    )
    yield (
        f"  contact    {contact} of the time, of which rough {rough}, unknown {unknown}"
    )
    yield f"  threshold  {_threshold(felt)}"
    if felt.scores:
        yield (
            f"  felt       false bumps: {felt.scores.false_bumps}; dips: "
            f"{felt.scores.dips}"
        )
    for note in felt.notes:
        yield output.styled("yellow", "  note", f"       {note}")
    if felt.events:
        yield "  events     " + ", ".join(
            f"{count} x {kind}" for kind, count in sorted(felt.events.items())
        )
    if summary.faults:
        yield "  silenced   " + ", ".join(
            f"{count} x {cause}" for cause, count in summary.faults.items()
        )
    for kind, path in felt.files.items():
        yield f"  {kind:10} {path!s}"
    yield f"  took       {summary.elapsed:.2f} s, {summary.speed:.3g} x real time"
    if not summary.contact:
        cause, command = _no_contact(felt)
        yield output.styled("bold red", "NO CONTACT was found: nothing vibrates.")
        yield f"  cause      {cause}"
        yield f"  try        {command}"


def _threshold(result: Felt) -> str:
    floor = result.floor
    threshold = f"{result.pipeline.detector.threshold.dbfs:.1f} dBFS"
    if floor is None:
        return f"{threshold}, as given"
    if floor.gated:
        return (
            f"{threshold} at the end; the sound is turned down in its pauses, so "
            "contact is found as in a live run"
        )
    if floor.known:
        over = floor.floor_dbfs > floor.threshold_dbfs
        words = (
            ", louder than any threshold: all of it is taken as touch" if over else ""
        )
        return (
            f"{threshold}; the recording's noise floor is {floor.floor_dbfs:.1f} "
            f"dBFS{words}"
        )
    if floor.loudest_dbfs < FLOOR_SILENT_DBFS:
        why = (
            "too short to show its noise"
            if result.summary.contact
            else "digital silence"
        )
        return f"none: the recording is {why}"
    return (
        "none: the recording holds no steady silence, so all of it is taken as touch; "
        "--threshold DBFS if it is not"
    )


def _no_contact(result: Felt) -> tuple[str, str]:
    """Return the likely cause of a recording without contact, and the next command."""
    floor = result.floor
    loudest = result.summary.loudest_dbfs
    again = f"tactophone feel {shlex.quote(str(result.path))} --threshold"
    if "sound" in result.summary.faults:
        return (
            "the samples are no sound: see the note",
            "write the file again: 16 or 24 bits, or floats from -1 to 1",
        )
    if result.summary.faults:
        return (
            "the model's output is invalid",
            f"tactophone model show {shlex.quote(result.pipeline.detector.name)}",
        )
    if loudest < FLOOR_SILENT_DBFS:
        return (
            "the recording is digital silence: no microphone was connected",
            "tactophone check",
        )
    if loudest < CHECKED_SILENT_DBFS:
        return (
            f"loudest window: {loudest:.1f} dBFS; the microphone or its gain is off",
            "tactophone check",
        )
    if floor is None:
        return (
            f"loudest window: {loudest:.1f} dBFS, under the threshold that was given",
            f"{again} {loudest - 10:.0f}",
        )
    if floor.gated:
        return (
            f"loudest window: {loudest:.1f} dBFS, and the sound is turned down in its "
            "pauses; if it is touch:",
            f"{again} {loudest - 10:.0f}",
        )
    found = (
        f"nothing is louder than its steady noise of {floor.floor_dbfs:.1f} dBFS; "
        "if all of it is touch:"
    )
    return found, f"{again} {floor.floor_dbfs - 6:.0f}"


def add_arguments(parser: argparse.ArgumentParser) -> None:
    add = parser.add_argument
    add(
        "recordings",
        nargs="+",
        type=Path,
        metavar="RECORDING",
        help=(
            "WAV or FLAC at 2 kHz or more; one channel, or two: contact microphone, "
            "air microphone; a folder of them; or a run, an MCAP file that --record "
            "wrote"
        ),
    )
    add(
        "--finger",
        default="",
        metavar="NAME",
        help="only this finger of a hand's log (default: all)",
    )
    options.add_recorded_channels(parser)
    add(
        "--out",
        type=Path,
        default=Path(),
        metavar="DIR",
        help="folder for the results; created if it does not exist",
    )
    add(
        "--profile",
        dest="rendering.profile",
        choices=(*PROFILES, *passthrough_names()),
        default="graded",
        metavar="NAME",
        help=f"rendering profile: {', '.join(PROFILES)}; "
        f"or the sound itself: {', '.join(passthrough_names())}",
    )
    options.add_figure(parser)
    add(
        "--json",
        action="store_true",
        help="print the summary as JSON, and write the timeline as JSON too",
    )
    for name in options.flags_of("feel"):
        options.add_flag(parser, name)
    page.add_dashboard(parser)


def run(args: argparse.Namespace) -> int:
    """Process each recording; a failure is reported, and the others continue."""
    output.make_folder(args.out)
    # The sound of logs is kept for the page to play, and no longer.
    with TemporaryDirectory(prefix=".tactophone-", dir=args.out) as folder:
        return _run(args, Path(folder))


def _run(args: argparse.Namespace, folder: Path) -> int:
    results = list[tuple[FoundSound, Felt]]()
    failures = list[str]()
    settings = options.settings_of(args)

    def failed(message: str) -> None:
        failures.append(message)
        output.print_error(message)

    for sound, stem in unique_stems(
        sounds_of(args.recordings, folder, finger=args.finger, report=failed)
    ):
        try:
            felt = _feel(sound, stem, args, settings)
        except (TactophoneError, OSError) as error:
            name = str(sound.origin)
            message = str(error).replace(str(sound.path), name)
            failed(message if message.startswith(name) else f"{name}: {message}")
            continue
        results.append((sound, felt))
        if not args.json:
            output.show(felt, _parts(felt), as_json=False)
    if args.json:
        output.show([felt for _, felt in results], as_json=True)
    if page.wanted(args, settings) and results:
        from tactophone.app.playback import PlayableRecording

        takes = [
            PlayableRecording(
                sound.path.name, [sound.path], [felt.pipeline], felt.truth
            )
            for sound, felt in results
        ]
        page.play_on_page(settings, takes, name="feel")
    return 1 if failures else 0


def _feel(
    sound: FoundSound, stem: str, args: argparse.Namespace, settings: Settings
) -> Felt:
    path = sound.path
    with (
        output.as_private_as(path),
        output.progress("processing", note=path.name) as update,
    ):
        felt = feel(
            path,
            args.out,
            settings,
            stem=stem,
            channels=args.channels,
            plot=args.plot,
            timeline_json=args.json,
            report=lambda done, size: update(completed=done, total=size),
        )
    if felt.tip_warning:
        output.note(f"{sound.origin}: {felt.tip_warning}")
    return replace(felt, path=sound.origin)
