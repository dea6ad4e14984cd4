"""Open Sound Control: predictions and vibration out, the emergency stop in.

OSC has no authentication. So the only address that is listened to is
``/tactophone/stop``, and only where asked for.
"""

import socket
import time
from collections import Counter
from typing import Any, Self

from tactophone.core.errors import ConfigError
from tactophone.live.log.reader import Passed, PredictionReader
from tactophone.net.link.udp import host_towards, pass_only

OSC_INTERVAL = 0.004
"""Seconds between two reads: well under the interval of the predictions, as each drives
a device."""

REPEATS = 10
"""How often the last messages of a finger are sent again: a network may lose any of
them, and what OSC drives keeps the value that it has."""

REPEAT_INTERVAL = 0.1
"""Seconds between two of these; over a second, as some losses come in a row."""

LAST_INTERVAL = 0.02
"""The same at the end of the bridge, for which the run waits."""

DATAGRAMS = 32
"""Datagrams read at a time."""

STOP = b"/tactophone/stop"

STOPS = (
    [(0, STOP), (16, bytes(4))],
    [(0, b"#bundle\0"), (20, STOP), (36, bytes(4))],
)
"""What a stop begins with: a message, or a bundle whose first message it is; a time of
8 bytes and the message's size follow the bundle's name. On Linux nothing else reaches
the socket, so that no flood keeps a stop out."""

VRCHAT = {
    "roughness": "TactophoneRoughness",
    "contact": "TactophoneContact",
    "amplitude": "TactophoneVibration",
}
"""Avatar parameters, floats from 0 to 1, that VRChat and bHapticsOSC map to devices."""


class OscBridge:
    """Sends each prediction as OSC messages; a context manager whose `read` is called
    every `OSC_INTERVAL`.

    Where predictions end, and when the bridge does, a last message has no contact and
    amplitude 0, as what OSC drives keeps the value that it has. It is sent `REPEATS`
    times more.

    - ``name``: of a run that exists already.
    - ``target``: host and port to send to, such as ``127.0.0.1:9000``.
    - ``finger``: name of the only finger in the addresses; a hand's fingers have their
      own.
    - ``listen``: UDP port at which ``/tactophone/stop`` is accepted, on this machine's
      loopback interface; 0: none.
    - ``avatar``: whether to send VRChat's avatar parameters too. Each of them may drive
      a device, so at an operator all are 0 while nothing vibrates, as when muted.
    - ``counts``: datagrams received: ``stop``, and ``ignored``.
    """

    interval = OSC_INTERVAL
    title = "the OSC bridge"

    def __init__(
        self,
        name: str,
        target: str,
        *,
        finger: str = "index",
        listen: int = 0,
        avatar: bool = False,
    ) -> None:
        host, _, port = target.rpartition(":")
        if not host or not port.isdecimal() or not 0 < int(port) < 1 << 16:
            raise ConfigError(
                f"--bridge osc={target}: wanted HOST:PORT, such as osc=127.0.0.1:9000"
            )
        if not 0 <= listen < 1 << 16:
            raise ConfigError(
                f"bridges.osc_listen = {listen}: wanted a port from 1 to 65535; 0: none"
            )
        self._address = (host, int(port))
        self._listen = listen
        self._avatar = avatar
        self._reader = PredictionReader(name, finger=finger)
        self._vibrates = self._reader.watcher.state().role != "robot"
        self._last: dict[str, tuple[Passed, float, int]] = {}
        """Of each finger, what was sent last and when, and how often it is sent
        again."""
        self.counts: Counter[str] = Counter()
        self._inbound: socket.socket | None = None

    def __enter__(self) -> Self:
        try:
            self._open_outbound()
            if self._listen:
                self._inbound = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
                self._inbound.setblocking(False)
                pass_only(self._inbound, STOPS)
                self._inbound.bind(("127.0.0.1", self._listen))
        except (OSError, UnicodeError) as error:
            # A name that no machine can have is a UnicodeError.
            raise ConfigError(
                f"--bridge osc: {error}; choose another address or port"
            ) from error
        return self

    def __exit__(self, *_: object) -> None:
        self._pass_on(self._reader.silenced())
        while self._repeat(LAST_INTERVAL):
            time.sleep(LAST_INTERVAL)
        self._outbound.close()
        if self._inbound:
            self._inbound.close()

    def read(self) -> None:
        self._receive()
        self._pass_on(self._reader.read())
        self._repeat(REPEAT_INTERVAL)

    def lost(self) -> str:
        return f"{self._reader.missed} predictions" if self._reader.missed else ""

    def _open_outbound(self) -> None:
        """Look the target's name up, once for all messages, and open a socket to it,
        bound to the loopback alone if the target is there."""
        host, port = self._address
        found = socket.getaddrinfo(host, port, type=socket.SOCK_DGRAM)
        family, *_, target = found[0]
        self._target: Any = target
        self._outbound = socket.socket(family, socket.SOCK_DGRAM)
        self._outbound.setblocking(False)
        if own := host_towards([(str(self._target[0]), port)]):
            self._outbound.bind((own, 0))

    def _pass_on(self, found: list[Passed]) -> None:
        self._send(found)
        now = time.monotonic()
        self._last |= {passed.finger: (passed, now, REPEATS) for passed in found}

    def _repeat(self, interval: float) -> bool:
        """Send a finger's last messages again where they were sent ``interval`` s ago
        and say that nothing is felt; return whether there were any to be sent again."""
        now = time.monotonic()
        waiting = False
        for finger, (passed, sent, left) in self._last.items():
            if not left or passed.contact or passed.command.amplitude:
                continue
            waiting = True
            if now - sent >= interval:
                self._send([passed])
                self._last[finger] = passed, now, left - 1
        return waiting

    def _send(self, found: list[Passed]) -> None:
        for passed in found:
            for address, values in self._messages(passed):
                try:
                    self._outbound.sendto(_message(address, values), self._target)
                except OSError:
                    self.counts["not sent"] += 1

    def _messages(self, passed: Passed) -> list[tuple[str, Any]]:
        base = f"/tactophone/{passed.finger}"
        command = passed.command
        messages: list[tuple[str, Any]] = [
            (f"{base}/prediction", list(passed.prediction.probabilities)),
            (f"{base}/roughness", passed.roughness),
            (f"{base}/contact", int(passed.contact)),
            (f"{base}/vibration", [command.amplitude, command.frequency]),
        ]
        if self._avatar:
            values = {
                "roughness": passed.roughness,
                "contact": float(passed.contact),
                "amplitude": command.amplitude,
            }
            if self._vibrates and not command.amplitude:
                values = dict.fromkeys(values, 0.0)
            # An avatar has one parameter for each name, so the parameters of a hand end
            # with the finger's name.
            ending = (
                passed.finger.title().replace("-", "")
                if len(self._reader.fingers) > 1
                else ""
            )
            messages += [
                (f"/avatar/parameters/{VRCHAT[name]}{ending}", value)
                for name, value in values.items()
            ]
        return messages

    def _receive(self) -> None:
        for _ in range(DATAGRAMS if self._inbound else 0):
            try:
                datagram = self._inbound.recv(1 << 12) if self._inbound else b""
            except BlockingIOError:
                return
            if _is_stop(datagram):
                self.counts["stop"] += 1
                self._reader.watcher.ask("stop")
            else:
                self.counts["ignored"] += 1


def _message(address: str, values: Any) -> bytes:
    from pythonosc.osc_message_builder import OscMessageBuilder

    builder = OscMessageBuilder(address)
    for value in values if isinstance(values, list) else [values]:
        builder.add_arg(value)
    return bytes(builder.build().dgram)


def _is_stop(datagram: bytes) -> bool:
    """Return whether a datagram is a stop, or a bundle that begins with one.

    >>> _is_stop(b"/tactophone/stop" + bytes(4) + b"," + bytes(3))
    True
    >>> _is_stop(b"/tactophone/stopped" + bytes(1))
    False
    """
    return any(
        all(datagram[at : at + len(piece)] == piece for at, piece in pieces)
        for pieces in STOPS
    )
