"""The guided recorder: protocol, file and verdict together; still no terminal."""

from dataclasses import dataclass, field
from pathlib import Path
from types import MappingProxyType

from tactophone.dataset.values import Dataset, Recording
from tactophone.perception.sensor_health.faults import Reference
from tactophone.recording.protocol import COUNTDOWN, DURATION, PROTOCOL, Key, Protocol, Stage, TakePlan
from tactophone.recording.safe_writer import TakeFile
from tactophone.recording.take_quality import TakeLevels, TakeMeter, Verdict, judge
from tactophone.types import AudioBlock, Touch


@dataclass(frozen=True, slots=True)
class Subject:
    """What is recorded: names the folder and fills in the manifest.

    Parameters
    ----------
    name, surface, material
        The object; what it is a piece of (splits keep one surface on one side); what it is made of.
    label
        A person's word.
    scenario
        How it is held: ``held``, ``table``, ``box``, or any word.
    session
        The day or sitting.
    """

    name: str
    label: Touch
    surface: str = ""
    material: str = ""
    scenario: str = "table"
    session: str = ""

    def recording(self, root: Path, take: TakePlan, channels: int) -> Recording:
        """Say what the manifest shall say of a take."""
        told = {"object": self.name, "material": self.material, "stroke": take.stroke, "pressure": take.pressure}
        return Recording(
            root / slug(self.name) / slug(self.scenario) / f"{take.name}.flac",
            self.surface or self.name,
            self.label,
            ("contact", "air")[:channels],
            take=take.name,
            scenario=self.scenario,
            session=self.session,
            properties=MappingProxyType({key: value for key, value in told.items() if value}),
        )


def slug(name: str) -> str:
    """Make a file name of any name.

    >>> slug("Lava stone, black/2")
    'lava-stone-black-2'
    """
    words = "".join(letter if letter.isalnum() else " " for letter in name.lower()).split()
    return "-".join(words) or "object"


@dataclass(frozen=True, slots=True)
class Plan:
    """How a session goes: where to, with which set-up, which takes, and their duration and countdown in s."""

    root: Path
    reference: Reference = field(default_factory=Reference)
    takes: tuple[TakePlan, ...] = PROTOCOL
    duration: float = DURATION
    countdown: float = COUNTDOWN


class Recorder:
    """Records an object's takes: feed it sound and keys, and show what its attributes say.

    Attributes
    ----------
    protocol
        Where the session stands.
    verdict, heard
        Of the last take; ``None`` before the first.
    made
        The recordings finished so far.
    """

    def __init__(self, subject: Subject, plan: Plan, known: Dataset | None, *, sample_rate: int, channels: int) -> None:
        self._subject, self._plan = subject, plan
        self._rate, self._channels = sample_rate, channels
        self._levels = _levels(subject, known)
        self.protocol = Protocol(
            plan.takes,
            sample_rate=sample_rate,
            done=self._levels,
            duration=plan.duration,
            countdown=plan.countdown,
        )
        self.verdict: Verdict | None = None
        self.heard: TakeLevels | None = None
        self.made: list[Recording] = []
        self._file: TakeFile | None = None
        self._meter = TakeMeter(sample_rate, plan.reference)

    def press(self, key: Key) -> None:
        """Do what a key asks; a take that is quit or retaken before its end is kept or discarded.

        Raises
        ------
        DatasetError
            If the disk is full; nothing recorded is lost.
        """
        before = self.protocol.stage
        self.protocol.press(key)
        if self._file and key is Key.RETAKE and self.protocol.stage is Stage.READY:
            self._file.discard()
            self._file = None
        if key is Key.RETAKE and before is Stage.JUDGED and self.protocol.stage is Stage.READY:
            self._levels.pop(self.protocol.take.name, None)
        if self._file and self.protocol.stage is Stage.DONE:
            self._finish()

    def push(self, block: AudioBlock) -> None:
        """Let time pass, and record what belongs to the take.

        Raises
        ------
        DatasetError
            If the disk is full; nothing recorded is lost.
        """
        sound = self.protocol.push(block)
        if not sound.size:
            return
        if self._file is None:
            recording = self._subject.recording(self._plan.root, self.protocol.take, self._channels)
            self._file = TakeFile.begin(self._plan.root, recording, sample_rate=self._rate)
            self._meter = TakeMeter(self._rate, self._plan.reference)
        self._file.write(sound)
        self._meter.push(sound)
        if self.protocol.stage is Stage.JUDGED:
            self._finish()

    def close(self) -> None:
        """End the session; a take in the making is kept as far as it has come."""
        self.press(Key.QUIT)

    def _finish(self) -> None:
        if self._file is None:
            return
        take = self.protocol.take
        self.heard = self._meter.heard
        self.verdict = judge(take, self.heard, self._levels, duration=self._plan.duration)
        self._levels[take.name] = self.heard.level_dbfs
        told = {"level_dbfs": f"{self.heard.level_dbfs:.2f}", "verdict": str(self.verdict)}
        if self.protocol.pauses:
            told["pauses"] = " ".join(f"{pause:g}" for pause in self.protocol.pauses)
        file, self._file = self._file, None
        self.made.append(file.finish(**told))


def _levels(subject: Subject, known: Dataset | None) -> dict[str, float]:
    """Level of each take that was made of this object before, and need not be made again."""
    if known is None:
        return {}
    return {
        one.take: float(one.known("level_dbfs") or "-inf")
        for one in known.recordings
        if one.known("object") == subject.name and one.scenario == subject.scenario and one.known("verdict") == "good"
    }
