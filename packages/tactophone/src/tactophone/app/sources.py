"""Where sound comes from: a device, a recording, a page's microphone, or the simulated
finger."""

from collections.abc import Iterable, Iterator
from contextlib import ExitStack
from dataclasses import dataclass
from functools import partial
from multiprocessing import Pipe
from multiprocessing.connection import Connection
from pathlib import Path
from typing import TYPE_CHECKING, Protocol, Self, cast

from tactophone.core import extras, plugins
from tactophone.core.errors import ConfigError
from tactophone.core.processes import is_same_file
from tactophone.core.settings import VIBRATION_FILE, Settings, change
from tactophone.core.tips import DEFAULT_TIP
from tactophone.core.types import LIVE_SAMPLE_RATE, AudioBlock, Source

if TYPE_CHECKING:  # their imports would slow down --help
    from tactophone.live.audio.files import RecordedSource
    from tactophone.live.runtime.wiring import OpenSource

SETTLING = 0.5
"""Seconds that are discarded after a source is opened and after each instruction."""

ONE_MICROPHONE_MODEL = "stylus"
"""The shipped model for one air microphone, and the tip it is for; `paper-mono` was
trained on a contact microphone."""

NO_FINGER = (
    "the simulated finger is part of tactophone-lab, which is not installed: "
    + extras.INSTALL_LABORATORY
)

UNATTENDED = ("finger", "file")
"""Sources in which no real person takes part."""


def open_source(settings: Settings) -> Source:
    """Open the source of ``settings.capture``; it delivers sound at the live sample
    rate.

    Raises `ConfigError` if the setting ``capture.device`` does not fit the source, and
    `DatasetError` if a recording is missing or damaged.
    """
    from tactophone.core.hand import each_finger
    from tactophone.live.audio.files import CombinedSource, FileSource
    from tactophone.live.audio.sources import open_device

    capture = settings.capture
    fingers = each_finger(settings)
    if opener := plugins.load(plugins.SOURCES, capture.source):
        return cast(Source, opener(settings))
    if capture.source == "finger":
        raise ConfigError(NO_FINGER)
    if capture.source == "ros":
        return _ros_source(capture.device)
    if capture.source != "file":
        return open_device(settings)
    for place, own in enumerate(fingers):
        if not own.capture.device and settings.is_hand:
            name = settings.fingers[place].name
            raise ConfigError(
                f'no recording is named for the finger {name}: write device = "FILE" '
                f"under [{name}]"
            )
        if not own.capture.device:
            raise ConfigError(
                "capture.source = 'file', but no file is named: give --source "
                "file:RECORDING"
            )
    sources = [
        recorded(file, file.path, file.duration)
        for own in fingers
        for file in [
            FileSource(
                own.capture.device, block_size=capture.block_size, loop=capture.loop
            )
        ]
    ]
    return CombinedSource(sources) if settings.is_hand else sources[0]


def refuse_overwriting(settings: Settings, written: Iterable[Path] = ()) -> None:
    """Raise `ConfigError` if the vibration, or a file of ``written``, would overwrite
    the recording that is the source, or the vibration a model or a calibration."""
    from tactophone.core.hand import each_finger

    fingers = each_finger(settings)
    sounds = [own.capture.device for own in fingers if own.capture.source == "file"]
    # What calibrates or trains anew may write over what it replaces.
    others = [
        name
        for own in fingers
        for name in (own.detector.model, own.detector.calibration)
    ]
    pairs = [(path, name) for path in written for name in sounds]
    if settings.output.actuator == "file":
        vibration = Path(settings.output.device or VIBRATION_FILE)
        pairs += [(vibration, name) for name in (*sounds, *others)]
    for path, name in pairs:
        if name and is_same_file(path, Path(name)):
            raise ConfigError(
                f"{path}: would overwrite the recording or model that is read, {name}; "
                "name another file to write"
            )


def recorded(source: Source, path: Path, duration: float) -> "RecordedSource":
    """Return the sound of a recording as a live source, with the labels of the data set
    that the file belongs to."""
    from tactophone.core.recordings.read import ground_truth
    from tactophone.core.recordings.values import touch_at
    from tactophone.live.audio.files import RecordedSource
    from tactophone.signal.perception.resample import Resampler

    resampler = Resampler(
        source.sample_rate, LIVE_SAMPLE_RATE, channels=source.channels
    )
    truth = ground_truth(path, duration=duration)
    return RecordedSource(
        source,
        duration=duration,
        resample=resampler.push,
        label_at=partial(touch_at, segments=truth),
    )


def _ros_source(topic: str) -> Source:
    extras.require_modules("cyclonedds")
    from tactophone.faces.bridges.ros import RosSource

    if not topic:
        raise ConfigError(
            "capture.source = 'ros', but no topic is named: give --source ros:/TOPIC"
        )
    source = RosSource(topic)
    if source.sample_rate != LIVE_SAMPLE_RATE:
        raise ConfigError(
            f"--source ros:{topic}: {source.sample_rate} Hz, but {LIVE_SAMPLE_RATE} Hz "
            "is needed; set its node so"
        )
    return source


def source_of(
    settings: Settings, *, page: bool = True
) -> "tuple[OpenSource, Connection | None]":
    """Return what opens the source in the robot's process, and where a page's sound
    goes; ``None`` for other sources.

    Raises `ConfigError` if the source is a page's microphone but no page is served.
    """
    if settings.capture.source != "browser":
        return open_source, None
    if not page:
        raise ConfigError(
            "--source browser takes the microphone of a page: add --dashboard, or "
            "--lan for a phone"
        )
    inbox, microphone = Pipe(duplex=False)
    return partial(_open_browser, inbox), microphone


def _open_browser(sound: Connection, _: Settings) -> Source:
    from tactophone.live.audio.sources import browser_source

    return browser_source(sound)


def for_one_microphone(settings: Settings) -> Settings:
    """Choose the model for one air microphone, where that is the source and no model is
    named.

    Anything may be the tip then, so the model's tip is taken unless the settings name
    one.
    """
    if (
        settings.capture.source not in ("browser", "microphone")
        or settings.detector.model
    ):
        return settings
    tip = (
        [f"capture.tip={ONE_MICROPHONE_MODEL}"]
        if settings.capture.tip == DEFAULT_TIP
        else []
    )
    return change(settings, [f"detector.model={ONE_MICROPHONE_MODEL}", *tip])


@dataclass(frozen=True, slots=True)
class SimulatedAct:
    """An instruction for the simulated person, ``rest``, ``stroke``, ``tap``, ``move``
    or ``take``, and seconds."""

    verb: str
    duration: float
    take: str = ""


class InstructedSource(Source, Protocol):
    """A source that obeys instructions as a person would."""

    def ask(self, act: SimulatedAct) -> None:
        """Begin an act; the sound that follows comes from it."""


class AudioInput:
    """An open source; a person touching ``object_name`` if it is the simulated finger.
    A context manager.

    The simulated person needs no time: minutes take seconds.
    """

    def __init__(self, settings: Settings, object_name: str) -> None:
        self.name = settings.capture.source
        self._person: InstructedSource | None = None
        if opener := plugins.load(plugins.INSTRUCTED_SOURCES, self.name):
            self._person = opener(settings, object_name)
            self.source: Source = self._person
        elif self.name == "finger":
            raise ConfigError(NO_FINGER)
        else:
            self.source = open_source(change(settings, ["capture.loop=false"]))
        self._resources = ExitStack()

    @property
    def simulated(self) -> bool:
        """Whether no real person takes part."""
        return self.name in UNATTENDED

    @property
    def device_losses(self) -> int:
        """Times that the sound device lost sound, and could not say how much."""
        from tactophone.live.audio.sources import LiveSource

        if not isinstance(self.source, LiveSource):
            return 0
        return self.source.device.xruns + self.source.device.losses

    def __enter__(self) -> Self:
        self._resources.enter_context(self.source)
        return self

    def __exit__(self, *_: object) -> None:
        self._resources.close()

    def __iter__(self) -> Iterator[AudioBlock]:
        return iter(self.source)

    def ask(self, act: SimulatedAct) -> None:
        """Instruct the simulated person, if there is one; a real person reads the
        screen."""
        if self._person is not None:
            self._person.ask(act)
