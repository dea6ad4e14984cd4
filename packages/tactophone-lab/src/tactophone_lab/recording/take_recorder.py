"""The guided recorder: protocol, file and take quality together; no terminal."""

from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

from tactophone.core.errors import DatasetError
from tactophone.core.microphones import MICROPHONES
from tactophone.core.recordings.values import Dataset, Recording
from tactophone.core.types import AudioBlock, Touch
from tactophone.signal.perception.health import Reference
from tactophone_lab.recording.protocol import (
    COUNTDOWN,
    TAKE_DURATION,
    Key,
    Protocol,
    Stage,
)
from tactophone_lab.recording.quality import GOOD, TakeLevels, TakeMeter, assess_take
from tactophone_lab.recording.safe_writer import TakeWriter, refuse_unknown_part
from tactophone_lab.simulation.takes import TAKES, Take

MOST_GAPS = 100
"""Gaps of a take whose places are noted."""


@dataclass(frozen=True, slots=True)
class RecordedObject:
    """The recorded object: its name gives the folder, its other fields go to the
    manifest."""

    name: str
    label: Touch
    """As a person says."""
    surface: str = ""
    """What several objects may share: splits keep a surface on one side."""
    material: str = ""
    scenario: str = "table"
    """How it is held: ``held``, ``table``, ``box``, or any other name."""
    session: str = ""
    """The day or sitting."""

    def __post_init__(self) -> None:
        # Names from a list or a paste end in spaces or line ends, which no manifest
        # keeps: the object would not be known again.
        for name in ("name", "surface", "material", "scenario", "session"):
            object.__setattr__(self, name, getattr(self, name).strip())

    def recording(self, root: Path, take: Take, channels: int) -> Recording:
        properties = {
            "object": self.name,
            "material": self.material,
            "stroke": take.stroke,
        }
        if take.stroke != "wiggle":  # of any pressure
            properties["pressure"] = take.pressure
        return Recording(
            root / slug(self.name) / slug(self.scenario) / f"{take.name}.flac",
            self.surface or self.name,
            self.label,
            MICROPHONES[:channels],
            take=take.name,
            scenario=self.scenario,
            session=self.session,
            properties={key: value for key, value in properties.items() if value},
        )


def slug(name: str) -> str:
    """Convert any name to a file name.

    >>> slug("Lava stone, black/2")
    'lava-stone-black-2'
    """
    words = "".join(
        letter if letter.isalnum() else " " for letter in name.lower()
    ).split()
    return "-".join(words) or "object"


@dataclass(frozen=True, slots=True)
class SessionPlan:
    """Output folder, calibrated reference, takes, and the takes' duration and countdown
    in s."""

    root: Path
    reference: Reference = field(default_factory=Reference)
    takes: tuple[Take, ...] = TAKES
    duration: float = TAKE_DURATION
    countdown: float = COUNTDOWN


class Recorder:
    """Records an object's takes: push sound, press keys, and show the attributes.

    Raises `DatasetError` if a take would replace another object's, or the sound of one
    that was cut off and nothing describes.

    ``quality`` and ``levels`` describe the last take; before the first they are empty
    and ``None``. ``recordings`` lists what is finished so far. ``device_losses`` counts
    the times that the device lost sound which is not missing in the blocks' ``start``.
    """

    def __init__(
        self,
        target: RecordedObject,
        plan: SessionPlan,
        known: Dataset | None,
        *,
        sample_rate: int,
        channels: int,
        device_losses: Callable[[], int] = lambda: 0,
    ) -> None:
        self._target = target
        self._plan = plan
        self._rate = sample_rate
        self._channels = channels
        _refuse_others(target, plan, known)
        self._levels = _levels(target, known)
        self.protocol = Protocol(
            plan.takes,
            sample_rate=sample_rate,
            done=self._levels,
            duration=plan.duration,
            countdown=plan.countdown,
        )
        self.quality = ""
        self.levels: TakeLevels | None = None
        self.recordings: list[Recording] = []
        self._file: TakeWriter | None = None
        self._device_losses = device_losses
        self._next: int | None = None
        """Sample that follows the newest block."""

    def press(self, key: Key) -> None:
        """Apply a key; quitting keeps an unfinished take, retaking discards it.

        Raises `DatasetError` if the disk is full; no recorded sound is lost.
        """
        before = self.protocol.stage
        self.protocol.press(key)
        if self._file and key is Key.RETAKE and self.protocol.stage is Stage.READY:
            self._file.discard()
            self._file = None
        if (
            key is Key.RETAKE
            and before is Stage.REVIEW
            and self.protocol.stage is Stage.READY
        ):
            self._levels.pop(self.protocol.take.name, None)
        if self._file and self.protocol.stage is Stage.DONE:
            self._finish()

    def push(self, block: AudioBlock) -> None:
        """Advance time by a block, and record the part that belongs to the take.

        Raises `DatasetError` if the disk is full; no recorded sound is lost.
        """
        missing = block.start - self._next if self._next is not None else 0
        self._next = block.start + block.size
        if missing > 0 and self._file and self.protocol.stage is Stage.RECORDING:
            self._note_gap(missing / self._rate)
        sound = self.protocol.push(block)
        if not sound.size:
            return
        if self._file is None:
            recording = self._target.recording(
                self._plan.root, self.protocol.take, self._channels
            )
            self._file = TakeWriter.begin(
                self._plan.root, recording, sample_rate=self._rate
            )
            self._meter = TakeMeter(self._rate, self._plan.reference)
            self._gaps: list[tuple[float, float]] = []
            self._lost_before = self._device_losses()
        self._file.write(sound)
        self._meter.push(sound)
        if self.protocol.stage is Stage.REVIEW:
            self._finish()

    def close(self) -> None:
        """End the session; an unfinished take is kept up to here."""
        self.press(Key.QUIT)

    def _note_gap(self, seconds: float) -> None:
        assert self._file
        place = self._file.size / self._rate
        self._gaps.append((place, seconds))
        listed = self._gaps[:MOST_GAPS]
        self._file.note(gaps=" ".join(f"{at:.3f}+{lost:.3f}" for at, lost in listed))

    def _finish(self) -> None:
        if self._file is None:
            return
        take = self.protocol.take
        self.levels = self._meter.levels
        self.quality = assess_take(
            take,
            self.levels,
            self._levels,
            duration=self._plan.duration,
            lost=_lost_in_words(self._gaps, self._device_losses() - self._lost_before),
        )
        self._levels[take.name] = self.levels.level_dbfs
        properties = {
            "level_dbfs": f"{self.levels.level_dbfs:.2f}",
            "quality": self.quality,
        }
        if self.protocol.pauses:
            properties["pauses"] = " ".join(
                f"{pause:g}" for pause in self.protocol.pauses
            )
        # Cleared first: a full disk raises in finish(), and close() must not finish the
        # same take twice.
        file = self._file
        self._file = None
        self.recordings.append(file.finish(**properties))


def _lost_in_words(gaps: list[tuple[float, float]], device_losses: int) -> str:
    """Return what a take lacks, given the place and length of each gap in s."""
    words = []
    if gaps:
        seconds = sum(lost for _, lost in gaps)
        places = f"{len(gaps)} places" if len(gaps) > 1 else f"{gaps[0][0]:.1f} s in"
        words.append(f"{seconds:.3f} s of sound was lost ({places})")
    if device_losses:
        times = "once" if device_losses == 1 else f"{device_losses} times"
        words.append(f"the sound device lost sound {times}")
    if words:
        words[-1] += ": end other programs, or give the device longer periods"
    return "; ".join(words)


def _refuse_others(
    target: RecordedObject, plan: SessionPlan, known: Dataset | None
) -> None:
    """Raise where a take of this object would get the file name of another's: names
    that differ in signs, spaces or case alone have the same one."""
    recordings = known.recordings if known else ()
    listed = {each.path.resolve(): each for each in recordings}
    for take in plan.takes:
        path = target.recording(plan.root, take, 1).path
        refuse_unknown_part(path)
        other = listed.get(path.resolve())
        if other is None and path.exists():
            raise DatasetError(
                f"{path} exists, and no metadata.csv says what it is: move it away, or "
                "choose another name for the object"
            )
        if other is None:
            continue
        name = other.known("object")
        if (name, other.scenario) != (target.name, target.scenario):
            raise DatasetError(
                f"{path} is of {name!r} ({other.scenario!r}), and {target.name!r} "
                f"({target.scenario!r}) would take its place: choose a name that "
                "differs in more than signs, spaces and case"
            )


def _level(recording: Recording) -> float:
    text = recording.known("level_dbfs") or "-inf"
    try:
        return float(text)
    except ValueError:
        raise DatasetError(
            f"{recording.path}: its level_dbfs in metadata.csv is {text!r}, not a "
            "number such as -33.7: correct it"
        ) from None


def _levels(target: RecordedObject, known: Dataset | None) -> dict[str, float]:
    """Return the level, in dBFS, of each good take of this object that exists
    already."""
    if known is None:
        return {}
    return {
        recording.take: _level(recording)
        for recording in known.recordings
        if (recording.known("object"), recording.scenario)
        == (target.name, target.scenario)
        and recording.known("quality") == GOOD
    }
