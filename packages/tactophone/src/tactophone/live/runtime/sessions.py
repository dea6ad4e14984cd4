"""Opens the encrypted sessions that the settings name: with whom, over which path, with
which codec."""

from collections import Counter
from collections.abc import Sequence

from tactophone.core.errors import ConfigError
from tactophone.core.settings import LinkSettings, Settings
from tactophone.core.types import LIVE_SAMPLE_RATE, MOST_OPERATORS
from tactophone.core.version import __version__
from tactophone.net.link.call_socket import AgentSocket, CallSocket
from tactophone.net.link.codec import NARROW_BAND, Codec
from tactophone.net.link.identity import Identity, Peers, identity_folder
from tactophone.net.link.packet import Address, split_address
from tactophone.net.link.send import SendGroup
from tactophone.net.link.session import Session
from tactophone.net.link.stream import RedundancyRule
from tactophone.net.link.udp import UdpSocket, resolve


def open_session(
    settings: Settings, *, call: Sequence[Address] = (), in_call: bool = False
) -> Session:
    """Open one end of an encrypted session: the robot calls an operator's addresses,
    the operator answers.

    With ``in_call`` nobody is trusted before `open_call`. Raises `ConfigError` if no
    peer is trusted yet otherwise.
    """
    folder = identity_folder(settings.link.identity)
    peers = Peers() if in_call else Peers.load(folder)
    if not (in_call or peers.items()):
        raise ConfigError(
            f"{folder}: this machine trusts no other yet; run `tactophone pair init` "
            "on both, then the line each prints"
        )
    return Session(
        Identity.load(folder), peers, call=list(call) or None, version=__version__
    )


def open_call(agent: AgentSocket, session: Session, *, restarts: int) -> CallSocket:
    """Wait for the path of a call, and trust the other end that was found there, and
    nobody else."""
    found = CallSocket(agent, ask=restarts > 0)
    session.trust(Peers({found.peer.fingerprint: found.peer.name}))
    return found


def operators_of(link: LinkSettings) -> list[Address]:
    """Return host and port of each operator that the robot calls.

    Raises `ConfigError` if there is none, one twice, or more than `MOST_OPERATORS`.

    >>> operators_of(LinkSettings(peer="trainer.local, 192.0.2.7:48471"))
    [('trainer.local', 48470), ('192.0.2.7', 48471)]
    >>> operators_of(LinkSettings(peer="::1, [2001:db8::7]:48472"))
    [('::1', 48470), ('2001:db8::7', 48472)]
    """
    try:
        operators = [
            split_address(name.strip(), link.port)
            for name in link.peer.split(",")
            if name.strip()
        ]
    except ValueError as error:
        raise ConfigError(
            f"link.peer = {link.peer!r}: {error}; write host or host:port"
        ) from None
    if not operators:
        raise ConfigError(
            "link.peer is empty: give the operator's host, as in --peer operator.local"
        )
    if len(operators) > MOST_OPERATORS:
        raise ConfigError(
            f"link.peer names {len(operators)} operators, but a robot sends to at "
            f"most {MOST_OPERATORS}: leave some out"
        )
    if twice := [
        host for (host, port), count in Counter(operators).items() if count > 1
    ]:
        raise ConfigError(
            f"link.peer names {twice[0]} twice: name each operator once, or with "
            "ports of their own"
        )
    return operators


def open_send_group(
    settings: Settings, channels: int, *, in_call: bool = False
) -> SendGroup:
    """Open the robot's sessions, with the codec and the redundancy that the settings
    ask for.

    Raises `ConfigError` as `operators_of` and `open_session`, and where two names lead
    to one address.
    """
    link = settings.link
    operators = [resolve(host, port) for host, port in operators_of(link)]
    every = Counter(address for found in operators for address in set(found))
    if twice := [address for address, count in every.items() if count > 1]:
        raise ConfigError(
            f"two names in link.peer lead to {twice[0][0]}: name each operator once"
        )
    codec = Codec(
        "pcm16" if link.codec == "pcm16" else "opus",
        channels=channels,
        packet_size=round(link.packet_duration * LIVE_SAMPLE_RATE),
        bandwidth=link.bandwidth or NARROW_BAND,
        bitrate_bps=link.bitrate_bps * len(settings.fingers),
    )
    fixed = link.redundancy >= 0
    rule = (
        RedundancyRule(least=link.redundancy, most=link.redundancy)
        if fixed
        else RedundancyRule()
    )
    sessions = [
        open_session(settings, call=found, in_call=in_call) for found in operators
    ]
    return SendGroup(sessions, codec, rule=rule, follow=not link.bandwidth, prompt=True)


def send_outgoing(session: Session, socket: UdpSocket | CallSocket) -> None:
    """Send the datagrams that a session has to send, over a socket that prefers its
    peer."""
    # First the socket: what the peer sends once it has these datagrams must meet the
    # new preference.
    socket.follow(session.remote)
    if outgoing := session.outgoing():
        socket.send(outgoing)
