"""Logs, and what pages, mailboxes, OSC and ROS say: each read as the process that gets
it does."""

import asyncio
import json
import struct
from collections.abc import Callable, Sequence
from functools import partial
from multiprocessing import Pipe
from pathlib import Path
from tempfile import TemporaryDirectory
from types import SimpleNamespace
from typing import Any

import msgspec

from tactophone.app.logged_run import write_sound
from tactophone.app.replay import Replay
from tactophone.core.errors import TactophoneError
from tactophone.core.types import HapticCommand, Prediction, Touch
from tactophone.faces.bridges import osc
from tactophone.live.audio.device import StreamDevice
from tactophone.live.log.log_topics import (
    CONTROLS,
    PACKETS,
    PREDICTION_TOPIC,
    RUN,
    Message,
    Packets,
    topics_of,
)
from tactophone.live.log.mcap import FORMAT, MAGIC, LogFile, read_log
from tactophone.live.log.reader import encoded
from tactophone.live.telemetry.records import Controls, EventBatch, RunStart
from tactophone.net.link.events import Connected, PacketReceived, write_event
from tactophone.net.link.packet import Packet, Payload, PayloadType
from tactophone_lab.game.stone_box import GameSettings

from .file_targets import chosen, file_run
from .target import Run, Target

_TOUCH = Prediction((0.1, 0.2, 0.7), Touch.ROUGH, 0.7, -20.0, 0.0, 0.256)


def _messages() -> list[bytes]:
    """A run's start, controls, packets and prediction, as JSON."""
    batches = [EventBatch(100.0, (write_event(Connected("robot", 1, 2)),))]
    for number in range(20):
        sound = Packet(
            number,
            1,
            Payload(
                PayloadType.L16_STEREO, 1_000 + 240 * number, b"\x10\x00\xf0\x00" * 240
            ),
        )
        batches.append(
            EventBatch(
                round(100 + number * 0.005, 5),
                (write_event(PacketReceived(bytes(sound), False)),),
            )
        )
    finger: Any = {
        "name": "",
        "settings": {"rendering.ceiling": 0.5},
        "calibration": "",
    }
    contents = (
        RunStart(
            role="operator",
            settings={"detector": {"model": "paper"}},
            epoch=1.7e9,
            fingers=[finger],
        ),
        Controls(True, 0.5, 1.0, "paper", -30.0),
        Packets(batches),
    )
    return [
        *map(msgspec.json.encode, contents),
        encoded(_TOUCH, HapticCommand(0.5, 60.0, 0.256)),
    ]


def _plain(contents: Sequence[bytes]) -> bytes:
    """Return a log without chunks, so that changes reach its messages."""

    def text(of: str) -> bytes:
        return struct.pack("<I", len(of)) + of.encode()

    def record(kind: int, body: bytes) -> bytes:
        return struct.pack("<BQ", kind, len(body)) + body

    records = [
        record(1, text(FORMAT) + text("")),
        record(3, struct.pack("<H", 1) + text("x") * 2 + text("{}")),
    ]
    names = (RUN.name, CONTROLS.name, PACKETS.name, PREDICTION_TOPIC.name)
    for number, name in enumerate(names):
        records.append(
            record(
                4, struct.pack("<HH", number, 1) + text(name) + text("json") + text("")
            )
        )
    records += [
        record(5, struct.pack("<HIQQ", number, 0, 0, 0) + each)
        for number, each in enumerate(contents)
    ]
    return MAGIC + b"".join(records) + record(15, bytes(4)) + MAGIC


def _read(path: Path) -> None:
    for reader in (
        lambda: list(Replay(read_log(path)).steps()),
        lambda: write_sound(path, path.parent),
    ):
        _in_words(reader)


def _in_words(call: Callable[[], object]) -> None:
    """Call it; where it refuses, it does so in printable words."""
    said = ""
    try:
        call()
    except TactophoneError as error:
        said = str(error)
    assert said.isprintable()


def logs() -> tuple[Sequence[bytes], Run]:
    with TemporaryDirectory() as folder:
        path = Path(folder, "log.mcap")
        with LogFile(path, topics_of([""], sound=False)) as log:
            for topic, content in zip(
                (RUN, CONTROLS, PACKETS), _messages(), strict=False
            ):
                log.write(Message(topic, 0.0, content))
        seeds = [_plain(_messages()), path.read_bytes()]
    return seeds, file_run("log.mcap", _read)


def log_messages() -> tuple[Sequence[bytes], Run]:
    """The JSON of one message, by the first byte."""
    contents, read = _messages(), file_run("log.mcap", _read)

    def replaced(number: int) -> Run:
        return lambda data: read(
            _plain([*contents[:number], data, *contents[number + 1 :]])
        )

    seeds = [bytes([number]) + content for number, content in enumerate(contents)]
    return seeds, chosen([replaced(number) for number in range(len(contents))])


def page_sound() -> tuple[Sequence[bytes], Run]:
    """A message of a page that listens, as the server checks it and the robot's side
    takes it."""
    from tactophone.faces.web.devices import is_sound

    heard: list[int] = []
    ours, _ = Pipe()
    device = StreamDevice(ours, lambda found, _: heard.append(len(found[0])), absent="")

    def run(data: bytes) -> None:
        if is_sound(data):
            device._take(data)
            assert heard.pop() == len(data) // 4 - 1

    return [bytes(4) + bytes(4 * 480), struct.pack("<If", 7, 0.5)], run


def player_requests() -> tuple[Sequence[bytes], Run]:
    from aiohttp import WSMsgType

    from tactophone_lab.game.game_server import _Player

    class View:
        """The page's end: says one thing, and takes answers in printable words."""

        closed = False
        said = ""

        def __aiter__(self) -> "View":
            return self

        async def __anext__(self) -> Any:
            if not self.said:
                raise StopAsyncIteration
            said, self.said = self.said, ""
            return SimpleNamespace(type=WSMsgType.TEXT, data=said)

        async def send_str(self, text: str) -> None:
            assert json.loads(text)
            assert text.isprintable()

        async def send_bytes(self, data: bytes) -> None:
            assert data

    folder, (finger, other), view = TemporaryDirectory(), Pipe(), View()
    order = (Touch.ROUGH, Touch.SMOOTH, Touch.SMOOTH, Touch.ROUGH, Touch.SMOOTH)
    game = GameSettings("none", [order], 1, finger, Path(folder.name, "results.jsonl"))
    run_ = SimpleNamespace(ask=lambda _: None)
    player = _Player(game, run_, view, 0, local=False)  # type: ignore[arg-type]

    def run(data: bytes) -> None:
        assert folder
        view.said = data.decode(errors="replace")
        asyncio.run(player.receive())
        while other.poll():
            kind, *values = other.recv()
            assert kind == "lay" or all(abs(value) < 10 for value in values)

    requests: list[dict[str, Any]] = [
        {"action": "begin", "trainer": True},
        {"action": "move", "x": 0.1, "y": 0.02, "force": 1.5},
        {"action": "choose", "stones": [0, 3]},
        {"action": "delay", "seconds": 0.1},
        {"action": "stop"},
    ]
    return [json.dumps(each).encode() for each in requests], run


def mailbox_words() -> tuple[Sequence[bytes], Run]:
    """What a mailbox says, one message a line, to an end that wants a code and then the
    other end."""
    import wormhole
    from twisted.internet.testing import MemoryReactorClock

    from tactophone.net.call import exchange

    own = object.__new__(exchange.Exchange)
    own._mailbox = "ws://mailbox"

    def explained(error: Exception) -> None:
        with own._explained():
            raise error

    def run(data: bytes) -> None:
        clock: Any = MemoryReactorClock()
        made: Any = wormhole.create(exchange.APPLICATION, "ws://127.0.0.1:1/v1", clock)
        connector, failures = made._boss._RC, []
        made.allocate_code(2)
        for wanted in (
            made.get_welcome,
            made.get_code,
            made.get_verifier,
            made.get_message,
        ):
            wanted().addErrback(failures.append)
        client = exchange.bounded_client()()
        client._RC, client.sendMessage = connector, lambda *_: None
        client.factory = SimpleNamespace(heard=0)
        connector.ws_open(client)
        for line in data.split(b"\n"):
            client.onMessage(line, False)
            clock.advance(0.1)
        for failure in failures:
            _in_words(partial(explained, failure.value))

    words: list[dict[str, Any]] = [
        {"type": "welcome", "welcome": {"motd": "x"}},
        {"type": "allocated", "nameplate": "7"},
        {"type": "claimed", "mailbox": "mb"},
        {"type": "message", "side": "x", "phase": "pake", "body": "7b7d"},
    ]
    error = {"type": "error", "error": "crowded", "orig": {}}
    seeds = [
        words,
        [*words[:3], error],
        [{"type": "welcome", "welcome": {"error": "full"}}],
        [words[0], error],
    ]
    return [
        b"\n".join(json.dumps(each).encode() for each in said) for said in seeds
    ], run


def osc_messages() -> tuple[Sequence[bytes], Run]:
    stop = b"/tactophone/stop" + bytes(4) + b"," + bytes(3)

    def run(data: bytes) -> None:
        assert osc._is_stop(data) <= (osc.STOP + b"\0" in data)

    return [stop, b"#bundle\0" + bytes(8) + struct.pack(">i", len(stop)) + stop], run


def ros_messages() -> tuple[Sequence[bytes], Run]:
    """Joint states, sound and its format, in CDR, as they come over Zenoh."""
    from tactophone.faces.bridges import ros, ros_topics

    source: Any = object.__new__(ros.RosSource)
    source._topic = "/audio"
    source.sample_rate = 48_000
    source.channels = 2
    source.faults = ros.Counter()
    motion = ros.JointMotion()

    def format_of(message: Any) -> None:
        _in_words(lambda: source._checked(message))

    def sound_of(message: Any) -> None:
        assert source._samples(message).shape[1] == source.channels

    readers: list[tuple[Any, Callable[[Any], None]]] = [
        (ros_topics.JointState, motion.push),
        (ros_topics.AudioDataStamped, sound_of),
        (ros_topics.AudioInfo, format_of),
    ]

    def reader(kind: Any, take: Callable[[Any], None]) -> Run:
        def run(data: bytes) -> None:
            try:
                message = kind.deserialize(data)
            except Exception:  # as `zenoh._Reader` has it
                return
            take(message)

        return run

    joints = ros_topics.JointState(
        ros_topics.header(1.5), ["a", "b"], [0.1, 0.2], [0.0], []
    )
    audio = ros_topics.AudioDataStamped(
        ros_topics.header(1.5), ros_topics.AudioData(data=list(range(8)))
    )
    seeds = [
        bytes([place]) + each.serialize()
        for place, each in enumerate((joints, audio, ros_topics.INFO))
    ]
    return seeds, chosen([reader(*each) for each in readers])


TARGETS = {
    "logs": Target(logs),
    "log_messages": Target(log_messages),
    "page_sound": Target(page_sound),
    "player_requests": Target(player_requests),
    "mailbox_words": Target(mailbox_words),
    "osc_messages": Target(osc_messages),
    "ros_messages": Target(ros_messages),
}
