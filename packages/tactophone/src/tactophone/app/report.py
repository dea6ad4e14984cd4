"""What a maintainer would ask for about a problem, as text that its sender reads
first."""

import platform
import re
import sys
from collections import Counter
from collections.abc import Iterator, Sequence
from importlib import metadata
from pathlib import Path

import msgspec

from tactophone.app.recordings import open_recording_for
from tactophone.core.errors import DatasetError, TactophoneError, plain
from tactophone.core.settings import SETTINGS, Settings
from tactophone.core.version import __version__
from tactophone.live.audio.survey import survey
from tactophone.live.log import log_topics
from tactophone.live.log.log_topics import Message
from tactophone.live.log.mcap import UNREADABLE, LogEnd, read_messages
from tactophone.live.telemetry.records import RunStart

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
"""Different warnings of a log, and runs, that are listed."""

MOST_LETTERS = 500
"""Letters of a warning that are repeated."""

ADDRESS = re.compile(
    r"(?<![\w.-])(?=[\d._-]*[a-z])[\w.-]+:\d+"
    r"|(?<![\w.])\d{1,3}(?:\.\d{1,3}){3}(?::\d+)?"
    r"|(?<![\w:])\[?(?:[0-9a-f]{0,4}:){2,}[0-9a-f]{0,4}(?![\w:])\]?(?::\d+)?",
    re.IGNORECASE,
)
"""A host with its port, or an address of IPv4 or IPv6.

Each begins where a word does, so that a long word of anybody's log is tried once.
"""

ANOTHER_MACHINE = "another machine"

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
        ("Log", _log(log, _other_machines(settings))),
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


def _log(log: Path | None, machines: Sequence[str]) -> Iterator[str]:
    if log is None:
        yield "none; `tactophone report --log run.mcap` adds its summary"
        return
    counts: Counter[str] = Counter()
    course = _Course(machines)
    begun: float | None = None
    ended = 0.0
    problem = ""
    try:
        for message in read_messages(log):
            if isinstance(message, LogEnd):
                problem = "" if message.complete else "it was not finished"
                continue
            begun = message.time if begun is None else begun
            ended = max(ended, message.time)
            counts[message.topic.name] += 1
            course.push(message, since=message.time - begun)
    except DatasetError as error:
        problem = f"cannot be read ({error})"
    except UNREADABLE as error:
        # A log from anywhere; the rest of the report is still of use.
        problem = f"a message cannot be read ({error})"
    if begun is not None:
        yield f"- {log.name}: {ended - begun:.1f} s, {counts.total()} entries"
    if problem:
        yield f"- {log.name}: {problem[:MOST_LETTERS]}"
    for topic, count in sorted(counts.items()):
        yield f"- {topic}: {count}"
    yield from course.lines()


def _other_machines(settings: Settings) -> list[str]:
    """Return the names of the machines that this one knows, the longest first."""
    names = {settings.link.peer.partition(":")[0]} - {""}
    try:
        from tactophone.net.link.identity import Peers, identity_folder

        peers = Peers.load(identity_folder(settings.link.identity))
        names |= {name for name, _ in peers.items()}
    except (ImportError, TactophoneError, OSError, RuntimeError):
        pass  # no link was ever encrypted here, or its peers cannot be read
    return sorted(names, key=len, reverse=True)


class _Course:
    """What a log says of its run: what it was, its counters and measures at its end,
    and its warnings with when they came first.

    Other machines' names and addresses are left out: those in links and settings with
    these, those in warnings by ``machines`` and by their form.
    """

    def __init__(self, machines: Sequence[str]) -> None:
        self._machines = machines
        self._runs: list[str] = []
        self._totals: dict[str, float] = {}
        self._warnings: dict[str, list[float]] = {}

    def push(self, message: Message, *, since: float) -> None:
        """Take a message that came ``since`` s after the first."""
        match message.topic.name:
            case log_topics.RUN.name:
                run = msgspec.json.decode(message.data, type=RunStart)
                versions = sorted(run.versions.items())
                shown = ", ".join(f"{name} {version}" for name, version in versions)
                self._runs.append(f"{run.role} of {shown}"[:MOST_LETTERS])
            case log_topics.HEALTH.name:
                totals = msgspec.json.decode(message.data, type=_Totals)
                # What was never measured is null.
                measured = {**totals.counters, **totals.gauges}.items()
                self._totals = {name: value for name, value in measured if value}
            case log_topics.EVENTS.name:
                event = msgspec.json.decode(message.data, type=_Event)
                if event.level < WARNING:
                    return
                text = self._without_machines(event.message[:MOST_LETTERS])
                if text in self._warnings or len(self._warnings) < MOST_WARNINGS:
                    self._warnings.setdefault(text, []).append(since)

    def _without_machines(self, text: str) -> str:
        for name in self._machines:
            text = re.sub(rf"'?(?<!\w){re.escape(name)}(?!\w)'?", ANOTHER_MACHINE, text)
        return ADDRESS.sub(ANOTHER_MACHINE, text)

    def lines(self) -> Iterator[str]:
        for run in self._runs[:MOST_WARNINGS]:
            yield f"- {run}"
        for name, value in self._totals.items():
            yield f"- {name}: {value:.6g}"
        for text, times in self._warnings.items():
            yield f"- {len(times)} x from {times[0]:.1f} s on: {text}"


class _Totals(msgspec.Struct):
    counters: dict[str, float]
    gauges: dict[str, float | None]


class _Event(msgspec.Struct):
    level: int
    message: str


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
