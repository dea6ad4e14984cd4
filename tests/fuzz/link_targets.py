"""The link's parsers, and its sessions as a stranger, a man in the middle and a faulty
peer reach them."""

import contextlib
import random
import socket
from collections.abc import Sequence
from typing import Any, cast

from pylibsrtp import Error

from tactophone.core.errors import PacketError
from tactophone.core.types import Prediction, Touch
from tactophone.net.call.messages import (
    Accepted,
    Hello,
    Offer,
    Refused,
    read_message,
    write_message,
)
from tactophone.net.call.messages import Address as Candidate
from tactophone.net.link.call_socket import (
    DATAGRAM,
    PEER,
    CallPeer,
    CallSocket,
    write_peer,
)
from tactophone.net.link.codec import Codec, open_decoder
from tactophone.net.link.events import (
    Connected,
    Disconnected,
    Event,
    PacketReceived,
    Renewed,
    read_event,
    write_event,
)
from tactophone.net.link.identity import Identity, Peers
from tactophone.net.link.packet import (
    Packet,
    Payload,
    PayloadType,
    parse_packet,
    read_prediction,
    read_predictions,
    write_predictions,
)
from tactophone.net.link.receive import ReceiveSession
from tactophone.net.link.rtcp import (
    Goodbye,
    Introduction,
    ReceiverReport,
    ReceiverRequest,
    SenderReport,
    parse_report,
)
from tactophone.net.link.send import SendGroup
from tactophone.net.link.session import BUSY_PAUSE, SESSION_TIMEOUT, Session
from tactophone.net.link.stats import Reception

from .target import Run, Target

ROBOT, OPERATOR = Identity.create("robot"), Identity.create("operator")
AT_ROBOT, AT_OPERATOR = "robot", "operator"

_SOUND = bytes(Packet(7, 1, Payload(PayloadType.L16_STEREO, 960, b"\1\2" * 480)))
_REPEATED = bytes(
    Packet(
        8,
        1,
        Payload(PayloadType.L16_MONO, 960, b"ab"),
        (Payload(PayloadType.L16_MONO, 720, b"cd"),),
        marker=True,
    )
)
_REPORTS = [
    bytes(report)
    for report in (
        ReceiverReport(1, 2, 0.1, 3, 4, 0.001, 5, 0.2),
        SenderReport(1, 1.7e9, 5, 6, 7),
        Goodbye(1, "busy"),
        Introduction(1, "0.1.0"),
        ReceiverRequest(1, 1_000),
    )
]


def packets() -> tuple[Sequence[bytes], Run]:
    return [_SOUND, _REPEATED], parse_packet


def reports() -> tuple[Sequence[bytes], Run]:
    def run(data: bytes) -> None:
        bytes(parse_report(data))

    return _REPORTS, run


def predictions() -> tuple[Sequence[bytes], Run]:
    return [bytes(16), bytes(range(16))], lambda data: read_prediction(data, end=1.0)


def hand_predictions() -> tuple[Sequence[bytes], Run]:
    touch = Prediction((0.1, 0.2, 0.7), Touch.ROUGH, 0.75, -20.5, 1.0, 1.256)
    kind, hand = write_predictions({0: touch, 4: touch}, fingers=5)
    return [hand, hand[:17]], lambda data: read_predictions(
        Payload(kind, 0, data), end=1.0
    )


def logged_events() -> tuple[Sequence[bytes], Run]:
    events = (
        Connected("robot", 1, 2),
        Renewed(3, 4),
        Disconnected("hung up"),
        PacketReceived(_SOUND, report=False),
    )
    return [write_event(event) for event in events], read_event


def opus() -> tuple[Sequence[bytes], Run]:
    kinds = (PayloadType.OPUS, PayloadType.MULTIOPUS, PayloadType.MULTIOPUS_HAND_3)
    decoders = [open_decoder(kind) for kind in kinds]

    def run(data: bytes) -> None:
        decoders[len(data) % len(decoders)].decode(data)

    return [bytes([0xE0]) + bytes(59), bytes([0xF8]) + bytes(99)], run


class Pair:
    """A caller and an answerer; whatever they send to each other may be changed on the
    way."""

    def __init__(self) -> None:
        self.robot = Session(
            ROBOT, Peers({OPERATOR.fingerprint: "operator"}), call=AT_OPERATOR
        )
        self.operator = Session(OPERATOR, Peers({ROBOT.fingerprint: "robot"}))
        self.now = 0.0
        self.connected: dict[Session, Connected] = {}

    def receive(self, to: Session, datagram: bytes, source: str) -> list[Event]:
        """Let one end take a datagram; its newest connection is kept by end."""
        events = to.receive(datagram, source=source, now=self.now)
        for event in events:
            if isinstance(event, Connected):
                self.connected[to] = event
        return events

    def ssrc(self, session: Session) -> int:
        """Return the SSRC under which one end sends; 0 without a connection."""
        return self.connected[session].local_ssrc if session.peer else 0

    def carry(self) -> list[tuple[Session, bytes, str]]:
        """Return the datagrams on the way: to whom, what and whence."""
        self.robot.poll(self.now)
        self.operator.poll(self.now)
        ways = (
            (self.robot, self.operator, AT_ROBOT),
            (self.operator, self.robot, AT_OPERATOR),
        )
        return [
            (to, datagram, source)
            for of, to, source in ways
            for datagram, _ in of.outgoing()
        ]

    def deliver(self) -> None:
        """Carry everything to where it belongs."""
        for to, datagram, source in self.carry():
            self.receive(to, datagram, source)

    def connect(self) -> None:
        for _ in range(20):
            self.now += 0.05
            self.deliver()
        assert self.robot.peer == "operator"


class Joined:
    """A session that is connected already, for a new owner: with the first datagram the
    owner hears of the connection."""

    def __init__(self, pair: Pair, session: Session) -> None:
        self._pair = pair
        self._session = session
        self._told = False

    def __getattr__(self, name: str) -> Any:
        return getattr(self._session, name)

    def receive(self, datagram: bytes, *, source: str, now: float) -> list[Event]:
        if self._told:
            return self._pair.receive(self._session, datagram, source)
        self._told = True
        return [self._pair.connected[self._session]]


def strangers() -> tuple[Sequence[bytes], Run]:
    """Any datagram at all, to sessions that are connected and to one that is not."""
    pair, waiting = Pair(), Session(OPERATOR, Peers({ROBOT.fingerprint: "robot"}))
    seeds = [datagram for _, datagram, _ in pair.carry()]
    pair.connect()

    def run(data: bytes) -> None:
        for session in (pair.robot, pair.operator, waiting):
            session.receive(data, source="eve", now=pair.now)
            session.receive(data, source=AT_ROBOT, now=pair.now)
            session.outgoing()
            assert session.faults["contained"] == 0

    return [*seeds, b"\x80\x62" + bytes(30), b"\x80\xc9" + bytes(30)], run


def handshakes() -> tuple[Sequence[bytes], Run]:
    """A man in the middle changes the datagrams of a handshake, to either side.

    Five bytes are one change: number of the datagram, kind of change, place (two bytes)
    and value.
    """

    def run(data: bytes) -> None:
        changes = [data[at : at + 5] for at in range(0, min(len(data), 40) - 4, 5)]
        pair, number = Pair(), 0
        for _ in range(7):
            pair.now += 0.12
            for to, datagram, source in pair.carry():
                arrived = datagram
                for change in changes:
                    if change[0] % 16 == number:
                        arrived = _changed(arrived, change)
                number += 1
                to.receive(arrived, source=source, now=pair.now)
        assert pair.operator.peer in (None, "robot")
        # What a library raises is contained, but it is still to be known.
        assert pair.operator.faults["contained"] == pair.robot.faults["contained"] == 0

    dice = random.Random(1)
    return [
        dice.randbytes(5 * count) for count in (1, 1, 1, 2, 3, 6) for _ in range(8)
    ], run


def _changed(datagram: bytes, change: bytes) -> bytes:
    at, value = int.from_bytes(change[2:4]) % max(1, len(datagram)), change[4]
    match change[1] % 6:
        case 0:
            return datagram[:at]
        case 1:
            return datagram + datagram[at:]
        case 2:
            return datagram[:at] + bytes([value]) * 4 + datagram[at + 4 :]
        case 3:
            return datagram[:at] + bytes([value]) + datagram[at:]
        case 4:
            return datagram[:at] + datagram[at + 1 + value :]
    return datagram[:at] + bytes([value]) + datagram[at + 1 :]


def faulty_robots() -> tuple[Sequence[bytes], Run]:
    """Packets that a paired robot encrypts.

    Each is a byte of its length, a byte of milliseconds that pass before it, and the
    packet; SSRC and length fit.
    """
    pair = Pair()
    pair.connect()

    def run(data: bytes) -> None:
        reception = Reception()

        def report_on(now: float, events: list[Event], _: bool) -> None:
            # Whatever was received, a report on it can be written.
            for event in events:
                if isinstance(event, PacketReceived) and not event.report:
                    with contextlib.suppress(PacketError):
                        found = parse_packet(event.packet)
                        reception.count(
                            found.sequence, found.payload.timestamp, now=now
                        )
                    bytes(reception.report(ssrc=1, of=2, now=now))

        end = ReceiveSession(cast(Session, Joined(pair, pair.operator)))
        end.tap = report_on
        end.receive([(b"", AT_ROBOT)], now=pair.now)
        for delay, packet in _packets_in(data, pair.ssrc(pair.robot)):
            pair.now += delay
            _send(pair.robot, packet)
            for to, datagram, source in pair.carry():
                if to is pair.operator:
                    end.receive([(datagram, source)], now=pair.now)
            end.poll(pair.now)
            end.pull(128, now=pair.now)
        _keep(pair)

    jumps = b"".join(
        _script(packet) for packet in (_small(0, 0), _small(1, (1 << 32) - 23_000)) * 6
    )
    return [
        _script(_SOUND[:200]) * 3,
        _script(_REPEATED) * 3,
        *map(_script, _REPORTS),
        jumps,
    ], run


def faulty_operators() -> tuple[Sequence[bytes], Run]:
    """Reports that a paired operator encrypts."""
    pair = Pair()
    pair.connect()

    def run(data: bytes) -> None:
        robot = cast(Session, Joined(pair, pair.robot))
        end = SendGroup([robot], Codec("pcm16"), follow=True)
        end.receive([(b"", AT_OPERATOR)], now=pair.now)
        for delay, packet in _packets_in(data, pair.ssrc(pair.operator)):
            pair.now += delay
            _send(pair.operator, packet)
            for to, datagram, source in pair.carry():
                if to is pair.robot:
                    end.receive([(datagram, source)], now=pair.now)
            end.poll(pair.now)
        _keep(pair)

    return [_script(report) for report in _REPORTS], run


def _small(sequence: int, timestamp: int) -> bytes:
    return bytes(
        Packet(sequence, 1, Payload(PayloadType.L16_MONO, timestamp, bytes(20)))
    )


def _script(packet: bytes) -> bytes:
    return bytes([len(packet), 5]) + packet


def _packets_in(data: bytes, ssrc: int) -> list[tuple[float, bytes]]:
    packets, at = [], 0
    while at + 2 < len(data) and len(packets) < 32:
        size, delay = data[at], data[at + 1]
        packet = data[at + 2 : at + 2 + size]
        at += 2 + size
        if len(packet) >= 12:
            report = 64 <= packet[1] & 0x7F <= 95
            place = 4 if report else 8
            # Only what the library itself encrypts, without contributing sources,
            # extension or padding it refuses.
            packet = bytes([0x80 | (packet[0] & 0x1F if report else 0)]) + packet[1:]
            packets.append(
                (
                    delay / 1_000,
                    packet[:place] + ssrc.to_bytes(4, "big") + packet[place + 4 :],
                )
            )
    return packets


def _send(session: Session, packet: bytes) -> None:
    # Libsrtp does not even send a repeated sequence number.
    with contextlib.suppress(Error):
        session.send(packet)


def _keep(pair: Pair) -> None:
    """Connect anew what a goodbye ended, and keep the rest from timing out."""
    if pair.robot.peer is None or pair.operator.peer is None:
        # A goodbye's reason keeps the robot from calling for a while, and the answerer
        # waits for its timeout.
        for _ in range(2):
            pair.now += SESSION_TIMEOUT + BUSY_PAUSE
            pair.carry()
        pair.connect()
    # Each end hears from the other one; a handshake that has begun is finished.
    for session in (pair.robot, pair.operator):
        session.send(bytes(SenderReport(pair.ssrc(session), pair.now, 0, 0, 0)))
    for _ in range(4):
        pair.deliver()


def call_messages() -> tuple[Sequence[bytes], Run]:
    """What the other end of a call says, through the mailbox."""
    offer = Offer(
        "user",
        "p" * 22,
        [Candidate("srflx", "192.0.2.7", 4000, 5, "f1")],
        [Candidate("relay", "192.0.2.9", 4001, 5, "f2")],
        "keeps",
        relay=True,
    )
    hello = Hello("lab-7", "robot", "0.1.0", ROBOT.fingerprint)
    return [
        write_message(each)
        for each in (hello, Accepted("operator"), offer, Refused("no"))
    ], read_message


def path() -> tuple[Sequence[bytes], Run]:
    """What comes over the path of a call: a datagram whatever it holds, and no words of
    the process that passes it on."""
    seeds = [b"\x80\x60\x00\x01" + bytes(4), b"\x01\x01\x00\x00", b'w{"name":"x"}']

    def run(data: bytes) -> None:
        here, there = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        with here, there:
            there.send(write_peer(CallPeer("other", "0A")))
            there.send(DATAGRAM + data[:1_200])
            with CallSocket(here) as own:
                assert own.receive(0.0) == [(data[:1_200], PEER)]

    return seeds, run


TARGETS = {
    "call_messages": Target(call_messages, (PacketError,)),
    "path": Target(path),
    "packets": Target(packets, (PacketError,)),
    "reports": Target(reports, (PacketError,)),
    "predictions": Target(predictions, (PacketError,)),
    "hand_predictions": Target(hand_predictions, (PacketError,)),
    "logged_events": Target(logged_events, (PacketError,)),
    "opus": Target(opus, (PacketError,)),
    "strangers": Target(strangers),
    "handshakes": Target(handshakes),
    "faulty_robots": Target(faulty_robots),
    "faulty_operators": Target(faulty_operators),
}
