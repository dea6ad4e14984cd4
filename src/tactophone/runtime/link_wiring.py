"""Opens the sessions that the settings name, and sends what they have to send."""

from collections import Counter
from collections.abc import Sequence
from pathlib import Path

from tactophone import __version__
from tactophone.errors import ConfigError
from tactophone.link import (
    IDENTITY_FOLDER,
    MOST_OPERATORS,
    NARROW_BAND,
    Address,
    Codec,
    DatagramSocket,
    Identity,
    Peers,
    RedundancyRule,
    SendGroup,
    Session,
    resolve_all,
)
from tactophone.settings import Link, Settings
from tactophone.types import LIVE_SAMPLE_RATE


def open_session(settings: Settings, *, call: Sequence[Address] = ()) -> Session:
    """Open one end of an encrypted session: the robot calls an operator's addresses, the operator answers.

    Raises `ConfigError` if no peer is trusted yet.
    """
    folder = Path(settings.link.identity or IDENTITY_FOLDER).expanduser()
    peers = Peers.load(folder)
    if not peers.items():
        raise ConfigError(f"{folder} holds no trusted peer: pair the two machines first with `tactophone pair`")
    return Session(Identity.load(folder), peers, call=list(call) or None, version=__version__)


def operators_of(link: Link) -> list[Address]:
    """Return host and port of each operator that the robot calls.

    Raises
    ------
    ConfigError
        If there is none, one twice, or more than `MOST_OPERATORS`.

    Examples
    --------
    >>> operators_of(Link(peer="trainer.local, 192.0.2.7:48471, ::1, [2001:db8::7]:48472"))
    [('trainer.local', 48470), ('192.0.2.7', 48471), ('::1', 48470), ('2001:db8::7', 48472)]
    """
    operators = [_endpoint(name.strip(), link.port) for name in link.peer.split(",") if name.strip()]
    if not operators:
        raise ConfigError("link.peer is empty: give the operator's host, as in --peer operator.local")
    if len(operators) > MOST_OPERATORS:
        raise ConfigError(
            f"link.peer names {len(operators)} operators, but a robot sends to at most {MOST_OPERATORS}: leave some out"
        )
    if twice := [host for (host, port), count in Counter(operators).items() if count > 1]:
        raise ConfigError(f"link.peer names {twice[0]} twice: name each operator once, or with ports of their own")
    return operators


def _endpoint(name: str, port: int) -> Address:
    """Split ``host``, ``host:port`` or ``[host]:port``; the colons of an IPv6 address alone are no port."""
    host, colon, number = name.rpartition(":")
    if not colon or name.endswith("]") or (":" in host and not host.endswith("]")):
        return name.strip("[]"), port
    if not number.isascii() or not number.isdecimal() or not 0 < int(number) < 1 << 16:
        raise ConfigError(f"link.peer = {name!r}: {number!r} is no port; write host or host:port")
    return host.strip("[]"), int(number)


def open_send_group(settings: Settings, channels: int) -> SendGroup:
    """Open the robot's sessions, with the codec and the redundancy that the settings ask for.

    Raises
    ------
    ConfigError
        As `operators_of` and `open_session`, and where two names lead to one address.
    """
    link = settings.link
    operators = [resolve_all(host, port) for host, port in operators_of(link)]
    every = Counter(address for found in operators for address in set(found))
    if twice := [address for address, count in every.items() if count > 1]:
        raise ConfigError(f"two names in link.peer lead to {twice[0][0]}: name each operator once")
    codec = Codec(
        "pcm16" if link.codec == "pcm16" else "opus",
        channels=channels,
        packet_size=round(link.packet_duration * LIVE_SAMPLE_RATE),
        bandwidth=link.bandwidth or NARROW_BAND,
        bitrate_bps=link.bitrate_bps * len(settings.fingers),
    )
    fixed = link.redundancy >= 0
    rule = RedundancyRule(least=link.redundancy, most=link.redundancy) if fixed else RedundancyRule()
    sessions = [open_session(settings, call=found) for found in operators]
    return SendGroup(sessions, codec, rule=rule, follow=not link.bandwidth, prompt=True)


def send_outgoing(session: Session, socket: DatagramSocket) -> None:
    """Send the datagrams that a session has to send, over a socket that prefers its peer."""
    # First the socket: what the peer sends once it has these datagrams must meet the new preference.
    socket.follow(session.remote)
    if outgoing := session.outgoing():
        socket.send(outgoing)
