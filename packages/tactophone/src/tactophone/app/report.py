"""What a maintainer would ask for about a problem, as text that its sender reads
first."""

import json
import platform
import sys
from collections.abc import Iterator, Sequence
from importlib import metadata
from pathlib import Path
from typing import TYPE_CHECKING, Any

from tactophone.app.recordings import open_recording_for
from tactophone.core.errors import TactophoneError, plain
from tactophone.core.settings import SETTINGS, Settings
from tactophone.core.version import __version__
from tactophone.live.audio.survey import survey
from tactophone.live.log import log_topics
from tactophone.live.log.log_topics import EVENTS, HEALTH

if TYPE_CHECKING:
    from mcap.reader import McapReader

PACKAGES = (
    "tactophone-lab",
    "numpy",
    "onnxruntime",
    "soundfile",
    "opuslib-next",
    "pylibsrtp",
    "pyOpenSSL",
    "jack-client",
    "sounddevice",
    "numba",
    "torch",
)
"""Packages whose versions explain most faults."""

WARNING = 3
"""Level of an event from which it is a warning, in Foxglove's ``Log``."""

MOST_WARNINGS = 20
"""Different warnings of a log that are listed."""

PRIVATE_SECTIONS = frozenset({"call", "link"})
"""Settings that may name keys, people or addresses; only that they were changed is
said."""


def report_lines(
    settings: Settings,
    *,
    log: Path | None = None,
    recording: Path | None = None,
    channels: Sequence[int] = (),
) -> Iterator[str]:
    """Yield the report's lines: versions, sound devices, changed settings, a log's
    summary and a recording's notes.

    Keys, names of other machines and sound are left out, and the home folder is
    written as ``~``.
    """
    yield "# Tactophone: report of a problem"
    yield ""
    yield "Read this before you send it, and delete what nobody should see."
    yield ""
    yield "## What I did, what I expected, what happened"
    yield ""
    yield "(write it here)"
    for heading, lines in (
        ("Versions", _versions()),
        ("Sound devices", _devices(settings)),
        ("Changed settings", _settings(settings)),
        ("Log", _log(log)),
        ("Notes on the recording", _notes(recording, settings, channels)),
    ):
        yield ""
        yield f"## {heading}"
        yield ""
        for line in lines:
            yield plain(_without_home(line))


def _without_home(line: str) -> str:
    try:
        home = str(Path.home())
    except RuntimeError:  # a user without a home
        return line
    return line.replace(home, "~") if len(home) > 1 else line


def _versions() -> Iterator[str]:
    yield f"- tactophone {__version__}"
    yield f"- Python {platform.python_version()} ({sys.platform}, {platform.machine()})"
    yield f"- {platform.platform()}"
    for name in PACKAGES:
        try:
            yield f"- {name} {metadata.version(name)}"
        except metadata.PackageNotFoundError:
            yield f"- {name}: not installed"


def _devices(settings: Settings) -> Iterator[str]:
    for device in survey(jack_server=settings.process.jack_server):
        yield (
            f"- {device.system} {device.name}: {device.inputs} in, {device.outputs} "
            "out, "
            f"{device.sample_rate} Hz"
        )
        yield f"  - microphones: {device.microphones or 'suits'}"
        yield f"  - actuator: {device.actuator or 'suits'}"


def _settings(settings: Settings) -> Iterator[str]:
    changed = 0
    for name, entry in SETTINGS.items():
        section, _, key = name.partition(".")
        value = getattr(getattr(settings, section), key)
        # As text, in which NaN is like itself.
        if repr(value) == repr(entry.default):
            continue
        changed += 1
        shown = "(changed)" if section in PRIVATE_SECTIONS else repr(value)
        yield f"- {name} = {shown}"
    if not changed:
        yield "none"


def _log(log: Path | None) -> Iterator[str]:
    if log is None:
        yield "none; `tactophone report --log run.mcap` adds its summary"
        return
    from mcap.exceptions import McapError
    from mcap.reader import make_reader

    try:
        with log.open("rb") as file:
            summary = make_reader(file).get_summary()
    except (OSError, McapError) as error:
        yield f"{log.name}: cannot be read ({error})"
        return
    found = summary.statistics if summary else None
    if summary is None or found is None:
        yield f"{log.name}: was not finished, so it has no summary"
        return
    duration = (found.message_end_time - found.message_start_time) / 1e9
    yield f"- {log.name}: {duration:.1f} s, {found.message_count} entries"
    for number, count in sorted(found.channel_message_counts.items()):
        yield f"- {summary.channels[number].topic}: {count}"
    try:
        with log.open("rb") as file:
            yield from _course(make_reader(file), begin=found.message_start_time)
    except (McapError, ValueError, KeyError, TypeError, AttributeError) as error:
        # A log from anywhere; the rest of the report is still of use.
        yield f"- {log.name}: its messages cannot be read ({error})"


def _course(reader: "McapReader", *, begin: int) -> Iterator[str]:
    """Yield what a log says of its run: what it was, its counters and measures at its
    end, and its warnings with when they came first.

    Names of other machines stand in links and settings, which are left out.
    """
    warnings: dict[str, list[float]] = {}
    totals: dict[str, Any] = {}
    topics = [each.name for each in (log_topics.RUN, HEALTH, EVENTS)]
    for _, channel, message in reader.iter_messages(topics=topics):
        content = json.loads(message.data)
        if channel.topic == HEALTH.name:
            totals = {**content["counters"], **content["gauges"]}
        elif channel.topic == log_topics.RUN.name:
            versions = content["versions"]
            shown = ", ".join(f"{name} {versions[name]}" for name in sorted(versions))
            yield f"- {content['role']} of {shown}"
        elif content["level"] >= WARNING:
            since = (message.log_time - begin) / 1e9
            warnings.setdefault(content["message"], []).append(since)
    for name, value in totals.items():
        # What was never measured is null, and what never happened is 0.
        if value:
            yield f"- {name}: {value:.6g}"
    for text, times in list(warnings.items())[:MOST_WARNINGS]:
        yield f"- {len(times)} x from {times[0]:.1f} s on: {text}"


def _notes(
    recording: Path | None, settings: Settings, channels: Sequence[int]
) -> Iterator[str]:
    if recording is None:
        yield "none; `tactophone report --recording finger.wav` adds what `feel` notes"
        return
    try:
        opened = open_recording_for(recording, settings, channels=channels)
        for _ in opened.steps():
            pass
    except TactophoneError as error:
        yield f"- {error}"
        return
    yield f"- {opened.duration:.1f} s, {opened.channels} channels"
    for note in opened.notes:
        yield f"- {note}"
