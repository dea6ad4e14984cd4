"""ROS 2 over DDS or Zenoh, without a ROS installation: a run's messages out, stop, mute
and joints in; a source; a bag.

Neither has authentication by default. So inbound topics can end a vibration, or delay
it by 150 ms (a robot's joints, which say when it moves), and no topic can begin one.
"""

import math
import os
import shutil
import time
from collections import Counter, defaultdict, deque
from collections.abc import Iterator, Sequence
from pathlib import Path
from types import SimpleNamespace
from typing import Any, Protocol, Self

import numpy as np
from cyclonedds.core import (
    DDSException,
    InstanceState,
    Policy,
    Qos,
    ReadCondition,
    SampleState,
    ViewState,
    WaitSet,
)
from cyclonedds.domain import Domain, DomainParticipant
from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from cyclonedds.util import duration

from tactophone.core.errors import ConfigError
from tactophone.core.types import (
    LIVE_SAMPLE_RATE,
    AlwaysOpen,
    AudioBlock,
    HapticCommand,
    PipelineStep,
)
from tactophone.faces.bridges import ros_topics as messages
from tactophone.live.log.reader import Passed, PredictionReader
from tactophone.live.telemetry.layout import Action
from tactophone.live.telemetry.watcher import Snapshot

ROS_INTERVAL = 0.004
"""Seconds between two reads: well under the interval of the predictions, as each drives
a device."""

SOUND_INTERVAL = 0.01
"""Seconds of sound in a message, at least."""

DIAGNOSTICS_INTERVAL = 1.0
"""Seconds between two diagnostics, as ROS's aggregator expects them."""

INFO_TIMEOUT = 10.0
"""Seconds to wait for the topic's AudioInfo: DDS finds its participants within a
few."""

WAIT = 0.02
"""Seconds without sound after which an empty block is returned, so that the reader of
the source can end."""

MOST_MESSAGES = 10
"""Messages of sound that are taken at a time."""

MOVES = 0.02
"""Speed of a joint, in rad/s or m/s, from which the robot counts as moving."""

STILL = 0.01
"""Speed of every joint, in rad/s or m/s, under which a moving robot counts as still."""

MOST_JOINTS = 256
"""Maximum joints of a message, and joints whose speeds are kept, as a sender could
invent new names without end."""

LOWEST_RATE = 2_000
"""Lowest sample rate of a sound topic that is taken, in Hz."""

HIGHEST_RATE = 192_000
"""Highest sample rate of a sound topic that is taken, in Hz."""

LONGEST_SOUND = 1.0
"""Seconds of sound in a message at most: whoever takes sound waits for as long as it
lasts."""

MOST_READS = 10
"""Joint states that are taken at a time."""

_SAMPLE = np.dtype("<i2")
"""A sample in a sound topic: 16 bits, little-endian."""

QOS = Qos(
    Policy.Reliability.Reliable(duration(milliseconds=100)),
    Policy.Durability.Volatile,
    Policy.History.KeepLast(10),
)
"""ROS 2's default for topics: reliable, volatile, the newest ten."""

BEST_EFFORT = Qos(
    Policy.Reliability.BestEffort,
    Policy.Durability.Volatile,
    Policy.History.KeepLast(10),
)
"""What a reader asks for that must hear every writer, a reliable one or not."""

LATCHED = Qos(
    Policy.Reliability.Reliable(duration(milliseconds=100)),
    Policy.Durability.TransientLocal,
    Policy.History.KeepLast(1),
)
"""A topic whose newest message reaches late subscribers too."""


class Transport(Protocol):
    """How messages of `tactophone.faces.bridges.ros_topics` reach ROS 2; topics are
    without their first slash."""

    def writer(self, topic: str, kind: type, *, latched: bool = False) -> Any:
        """Return a writer, which has ``write(message)``; a ``latched`` message reaches
        late subscribers too."""

    def reader(
        self,
        topic: str,
        kind: type,
        *,
        latched: bool = False,
        best_effort: bool = False,
    ) -> Any:
        """Return a reader, whose ``take(N=...)`` lists what came since the last call.

        One of ``best_effort`` hears every writer, and asks for nothing again that was
        lost; any other hears reliable writers alone.
        """

    def close(self) -> None:
        """Leave."""


_DOMAINS: dict[int, Domain] = {}
"""Domains that this process has configured; what is forgotten is left."""


def _bound_samples(domain: int) -> None:
    """Let no participant of this process take a message over `LARGEST_SAMPLE`: it is
    dropped before Python reads it.

    The user's own configuration stays. Raises `DDSException` if it cannot be read.
    """
    size = f"<MaxSampleSize>{messages.LARGEST_SAMPLE} B</MaxSampleSize>"
    bound = f"<Internal>{size}</Internal>"
    own = os.environ.get("CYCLONEDDS_URI", "").strip()
    if domain not in _DOMAINS:
        try:
            _DOMAINS[domain] = Domain(domain, f"{own},{bound}" if own else bound)
        except DDSException as error:
            # A participant made by another package has configured it.
            if error.code != DDSException.DDS_RETCODE_PRECONDITION_NOT_MET:
                raise


_VALID = SimpleNamespace(valid_data=True)
"""Note on a message that came over Zenoh, which has no such notes of its own."""


class DdsTransport:
    """A participant of a domain; raises `ConfigError` if it cannot be joined."""

    def __init__(self, domain: int) -> None:
        try:
            _bound_samples(domain)
            self._participant = DomainParticipant(domain)
        except DDSException as error:
            raise ConfigError(
                f"DDS cannot join domain {domain} ({error}): check CYCLONEDDS_URI"
            ) from error
        self._types = messages.open_type_store()

    def writer(self, topic: str, kind: type, *, latched: bool = False) -> Any:
        # By this hash ROS 2 of Iron and later tells that both ends have the same
        # definition.
        hashed = (
            f"typehash={self._types.hash_rihs01(messages.type_name(kind))};".encode()
        )
        return DataWriter(
            self._participant,
            self._topic(topic, kind, latched),
            qos=Qos(Policy.Userdata(hashed)),
        )

    def reader(
        self,
        topic: str,
        kind: type,
        *,
        latched: bool = False,
        best_effort: bool = False,
    ) -> Any:
        return _Reader(
            DataReader(
                self._participant,
                self._topic(topic, kind, latched),
                qos=BEST_EFFORT if best_effort else None,
            ),
            WaitSet(self._participant),
        )

    def close(self) -> None:
        """Do nothing: a participant leaves when it is no longer referred to."""

    def _topic(self, topic: str, kind: type, latched: bool) -> Any:
        return Topic(
            self._participant, f"rt/{topic}", kind, LATCHED if latched else QOS
        )


class _Reader:
    """Takes samples one by one, so that one that cannot be read takes no other with it:
    it comes as ``None``."""

    def __init__(self, reader: Any, waiting: Any) -> None:
        self._reader = reader
        self._waiting = waiting
        self._waiting.attach(
            ReadCondition(
                reader, ViewState.Any | InstanceState.Any | SampleState.NotRead
            )
        )

    def wait(self, seconds: float) -> None:
        """Return when there is a sample, at the latest after this time."""
        self._waiting.wait(duration(seconds=seconds))

    def take(self, N: int = 1) -> list[Any]:
        taken: list[Any] = []
        for _ in range(N):
            try:
                found = self._reader.take(N=1)
            except DDSException:
                raise
            except Exception:
                # Whatever the library raises at a stranger's bytes.
                found = [None]
            if not found:
                break
            taken += found
        return taken


def default_domain() -> int:
    text = os.environ.get("ROS_DOMAIN_ID", "0") or "0"
    if not text.isdecimal() or int(text) > 232:
        raise ConfigError(
            f"ROS_DOMAIN_ID is {text!r}, but it is a number from 0 to 232"
        )
    return int(text)


class JointMotion:
    """Tells from joint states whether a robot moves; each may cover only some joints,
    and give speeds or only places."""

    def __init__(self) -> None:
        self.moving = False
        self._speeds: dict[str, float] = {}
        self._places: dict[str, tuple[float, float]] = {}

    def push(self, joints: Any) -> None:
        """Take a ``sensor_msgs/JointState``; one of more joints than any robot has says
        nothing."""
        if max(map(len, (joints.name, joints.velocity, joints.position))) > MOST_JOINTS:
            return
        time = joints.header.stamp.sec + 1e-9 * joints.header.stamp.nanosec
        speeds = dict(zip(joints.name, joints.velocity, strict=False))
        for name, place in zip(joints.name, joints.position, strict=False):
            before, then = self._places.get(name, (place, time))
            self._places[name] = place, time
            if name not in speeds and time > then:
                speeds[name] = (place - before) / (time - then)
        self._speeds |= speeds
        if len(self._speeds) > MOST_JOINTS or len(self._places) > MOST_JOINTS:
            self._speeds = {}
            self._places = {}
        # A comparison with NaN is false: a joint whose speed is not known does not
        # move.
        self.moving = any(
            abs(speed) >= (STILL if self.moving else MOVES)
            for speed in self._speeds.values()
        )


class RosBridge:
    """Passes a run on to ROS 2; a context manager whose `read` is called every
    `ROS_INTERVAL`.

    - ``name``: of a run that exists already.
    - ``finger``: part of the topics, for an only finger; a hand's fingers have their
      own names.
    - ``publish``: whether to publish predictions, sound and diagnostics; otherwise only
      the sinks get something.
    - ``sinks``: devices to drive, as `open_sink` takes them.
    - ``domain``: ROS's domain; ``None`` takes ROS_DOMAIN_ID.
    - ``over``: ``dds`` or ``zenoh``.

    Raises `ConfigError` if the domain cannot be joined.
    """

    interval = ROS_INTERVAL
    title = "the ROS bridge"

    def __init__(
        self,
        name: str,
        *,
        finger: str = "index",
        publish: bool = True,
        sinks: Sequence[str] = (),
        domain: int | None = None,
        over: str = "dds",
    ) -> None:
        self._name = name
        self._publishes = publish
        self._domain = default_domain() if domain is None else domain
        self._over = over
        self._reader = PredictionReader(name, finger=finger)
        self._sinks = [
            sink
            for text in sinks
            for sink in messages.open_sinks(text, fingers=self._reader.fingers)
        ]
        self._snapshots: dict[str, Snapshot] = {}
        self._beat = 0
        self._role = ""
        """Of the run; empty until it has published a state."""
        self._joints: Any = None
        self._motion = JointMotion()
        self._moving = False
        self._amplitudes = dict.fromkeys(self._reader.fingers, 0.0)
        self._diagnosed_at = -DIAGNOSTICS_INTERVAL
        self._sound_at = 0.0

    def __enter__(self) -> Self:
        self._transport: Transport
        if self._over == "zenoh":
            # Its library is an extra of its own.
            from tactophone.faces.bridges.zenoh import ZenohTransport

            self._transport = ZenohTransport(self._domain)
        else:
            self._transport = DdsTransport(self._domain)
        writer = self._transport.writer
        if self._publishes:
            self._writers = {
                (finger, suffix): writer(f"tactophone/{finger}/{suffix}", kind)
                for finger in self._reader.fingers
                for suffix, kind in messages.PUBLISHED.items()
            }
            self._diagnostics = writer("diagnostics", messages.DiagnosticArray)
            # Kept, as a latched message lives as long as its writer.
            self._infos = [
                writer(
                    f"tactophone/{finger}/audio_info", messages.AudioInfo, latched=True
                )
                for finger in self._reader.fingers
            ]
            for info in self._infos:
                info.write(messages.INFO)
        self._devices = [(sink, writer(sink.topic, sink.kind)) for sink in self._sinks]
        actions: tuple[Action, ...] = ("stop", "mute")
        reader = self._transport.reader
        # The one has a reliable publisher repeat what was lost, the other hears all
        # others.
        self._requests = [
            (action, reader(f"tactophone/{action}", messages.Empty, best_effort=each))
            for action in actions
            for each in (False, True)
        ]
        return self

    def __exit__(self, *_: object) -> None:
        self._command(dict.fromkeys(self._reader.fingers, 0.0))
        self._transport.close()

    @property
    def missed(self) -> int:
        """Predictions that were passed on to nobody."""
        return self._reader.missed

    def lost(self) -> str:
        return f"{self.missed} predictions" if self.missed else ""

    def read(self) -> None:
        for action, reader in self._requests:
            # Whatever a stranger sends in numbers, one read takes some of it and asks
            # once. A writer that leaves sends an invalid sample, which is no message.
            if any(
                getattr(message, "sample_info", _VALID).valid_data
                for message in reader.take(N=10)
            ):
                self._reader.watcher.ask(action)
        self._follow_joints()
        waiting: defaultdict[str, deque[Passed]] = defaultdict(deque)
        for passed in self._reader.read():
            for suffix, message in (
                messages.predicted(passed).items() if self._publishes else ()
            ):
                self._writers[passed.finger, suffix].write(message)
            waiting[passed.finger].append(passed)
        # A device gets the fingers of a hand in one message, one prediction of each at
        # a time.
        while together := [queue.popleft() for queue in waiting.values() if queue]:
            self._command(
                {passed.finger: passed.command.amplitude for passed in together}
            )
        now = time.time()
        if self._publishes and not 0 <= now - self._sound_at < SOUND_INTERVAL:
            self._sound_at = now
            for place, finger in enumerate(self._reader.fingers):
                self._publish_sound(place, finger, now)
            self._diagnose(now)

    def _follow_joints(self) -> None:
        """Tell a robot's run when the robot begins and ends to move; an operator's has
        no use for joints."""
        self._role = self._role or self._reader.watcher.state().role
        if self._role != "robot":
            return
        if self._joints is None:
            self._joints = self._transport.reader(
                "joint_states", messages.JointState, best_effort=True
            )
        until = time.monotonic() + ROS_INTERVAL
        for _ in range(MOST_READS):
            found = self._joints.take(N=1)
            for joints in found:
                # A writer that leaves, or a stranger, may have sent something else.
                if isinstance(joints, messages.JointState):
                    self._motion.push(joints)
            # A stranger's messages may take long to read.
            if not found or time.monotonic() > until:
                break
        if self._motion.moving is not self._moving:
            self._moving = self._motion.moving
            self._reader.watcher.ask("moving", float(self._moving))

    def _command(self, amplitudes: dict[str, float]) -> None:
        self._beat += 1
        self._amplitudes |= {
            finger: min(max(amplitude, 0.0), 1.0)
            for finger, amplitude in amplitudes.items()
        }
        for sink, writer in self._devices:
            writer.write(sink.make(self._amplitudes, self._beat))

    def _publish_sound(self, place: int, finger: str, now: float) -> None:
        before = self._snapshots.get(finger)
        snapshot = self._snapshots[finger] = self._reader.watcher.snapshot(
            before, finger=place
        )
        if before is None or not len(snapshot.sound):
            return
        # The newest sample is about now; the first, as long ago as there are samples.
        begun = now - len(snapshot.sound) / LIVE_SAMPLE_RATE
        self._writers[finger, "audio"].write(messages.sound(snapshot.sound, begun))

    def _diagnose(self, now: float) -> None:
        if time.monotonic() - self._diagnosed_at < DIAGNOSTICS_INTERVAL:
            return
        self._diagnosed_at = time.monotonic()
        state = self._reader.watcher.state()
        counters, _ = self._reader.watcher.totals()
        values = {
            "armed": str(state.armed).lower(),
            "muted_because": state.muted_because,
            "link": state.link,
        }
        values |= {name: str(value) for name, value in counters.items() if value}
        values |= {"predictions_missed": str(self.missed)} if self.missed else {}
        status = messages.DiagnosticStatus(
            level=1 if state.faults else 0,
            name=f"tactophone: {self._name}",
            message="; ".join(fault.text for fault in state.faults) or "OK",
            hardware_id=",".join(self._reader.fingers),
            values=[messages.KeyValue(key, value) for key, value in values.items()],
        )
        self._diagnostics.write(
            messages.DiagnosticArray(messages.header(now), [status])
        )


class RosSource(AlwaysOpen):
    """A `core.types.Source` of 16-bit samples on a topic such as ``/audio``, with its
    format on ``/audio_info``.

    - ``faults``: ``odd size``: messages that hold no whole samples, or more than
      `LONGEST_SOUND`, which are dropped. What is no message of sound, as when a writer
      leaves, is left out.

    Raises `ConfigError` if nothing is published there, or in another format.
    """

    def __init__(self, topic: str, *, domain: int | None = None) -> None:
        self.faults: Counter[str] = Counter()
        self._topic = topic
        dds = DdsTransport(default_domain() if domain is None else domain)
        name = topic.lstrip("/")
        info = dds.reader(f"{name}_info", messages.AudioInfo, latched=True)
        self._reader = dds.reader(name, messages.AudioDataStamped)
        self.sample_rate, self.channels = self._format(info)

    def __iter__(self) -> Iterator[AudioBlock]:
        start = 0
        while True:
            self._reader.wait(WAIT)
            found = [
                message
                for message in self._reader.take(N=MOST_MESSAGES)
                if isinstance(message, messages.AudioDataStamped)
            ]
            for message in found:
                samples = self._samples(message)
                yield AudioBlock(samples, self.sample_rate, start)
                start += len(samples)
            if not found:
                yield AudioBlock(
                    np.zeros((0, self.channels), np.float32), self.sample_rate, start
                )

    def _samples(self, message: Any) -> np.ndarray[Any, np.dtype[np.float32]]:
        data = bytes(message.audio.data)
        size = _SAMPLE.itemsize * self.channels
        if len(data) % size or len(data) > LONGEST_SOUND * self.sample_rate * size:
            self.faults["odd size"] += 1
            data = b""
        samples = np.frombuffer(data, _SAMPLE).reshape(-1, self.channels)
        return (samples / np.float32(32_768)).astype(np.float32)

    def _format(self, reader: Any) -> tuple[int, int]:
        until = time.monotonic() + INFO_TIMEOUT
        while time.monotonic() < until:
            for info in reader.take(N=MOST_MESSAGES):
                if isinstance(info, messages.AudioInfo):
                    return self._checked(info)
            time.sleep(WAIT)
        raise ConfigError(
            f"--source ros:{self._topic}: nothing on {self._topic}_info within "
            f"{INFO_TIMEOUT:g} s: start the node, or "
            "check ROS_DOMAIN_ID"
        )

    def _checked(self, info: Any) -> tuple[int, int]:
        rate = info.sample_rate
        channels = info.channels
        kind = (info.coding_format, info.sample_format)
        if (
            kind != ("wave", "S16LE")
            or channels not in (1, 2)
            or not LOWEST_RATE <= rate <= HIGHEST_RATE
        ):
            raise ConfigError(
                f"--source ros:{self._topic}: {info.coding_format!r} "
                f"{info.sample_format!r} of {channels} channels at "
                f"{rate} Hz, but 'wave' 'S16LE' of 1 or 2 channels at {LOWEST_RATE} "
                "Hz or more is needed"
            )
        return int(rate), int(channels)


class RosBag:
    """Writes steps as a ROS 2 bag (rosbag2, MCAP storage) with the topics of the
    bridge; a context manager.

    ``epoch`` is in seconds since 1970, at the beginning of the steps' time. Raises
    `ConfigError` if the folder exists.
    """

    def __init__(
        self, folder: Path, *, epoch: float, fingers: Sequence[str] = ("index",)
    ) -> None:
        from rosbags.rosbag2 import StoragePlugin, Writer

        if folder.exists():
            raise ConfigError(
                f"--to-rosbag {folder}: exists already; name a new folder"
            )
        self._folder = folder
        self._store = messages.open_type_store()
        self._writer = Writer(folder, version=9, storage_plugin=StoragePlugin.MCAP)
        self._epoch = epoch
        self._fingers = fingers

    def __enter__(self) -> Self:
        try:
            self._begin()
        except OSError:
            self._leave_no_empty_bag()
            raise
        return self

    def _begin(self) -> None:
        self._writer.open()
        kinds = messages.PUBLISHED | {"audio_info": messages.AudioInfo}
        self._connections = {
            (finger, suffix): self._writer.add_connection(
                f"/tactophone/{name}/{suffix}",
                messages.type_name(kind),
                typestore=self._store,
            )
            for finger, name in enumerate(self._fingers)
            for suffix, kind in kinds.items()
        }
        for finger in range(len(self._fingers)):
            self._write(finger, "audio_info", 0.0, messages.INFO)

    def __exit__(self, *_: object) -> None:
        try:
            self._writer.close()
        finally:
            self._leave_no_empty_bag()

    def _leave_no_empty_bag(self) -> None:
        """Remove the folder if a full disk took nothing of it, so that the same command
        can be given again."""
        files = [path for path in self._folder.rglob("*") if path.is_file()]
        if not any(path.stat().st_size for path in files):
            shutil.rmtree(self._folder, ignore_errors=True)

    def write(self, step: PipelineStep) -> None:
        time = step.block.time
        if step.block.size:
            self._write(
                step.finger,
                "audio",
                time,
                messages.sound(step.block.samples, self._epoch + time),
            )
        for number, prediction in enumerate(step.predictions):
            command = (
                step.commands[number]
                if step.commands
                else HapticCommand(0.0, 0.0, prediction.end)
            )
            sound = self._epoch + prediction.end
            made = self._epoch + command.time
            passed = Passed(
                self._fingers[step.finger],
                prediction,
                command,
                sound,
                made,
                math.nan,
                computed=command.time,
            )
            for suffix, message in messages.predicted(passed).items():
                if suffix != "vibration":
                    self._write(step.finger, suffix, prediction.end, message)
                elif step.commands:
                    self._write(step.finger, suffix, command.time, message)

    def _write(self, finger: int, suffix: str, time: float, message: Any) -> None:
        self._writer.write(
            self._connections[finger, suffix],
            round((self._epoch + time) * 1e9),
            message.serialize(),
        )
