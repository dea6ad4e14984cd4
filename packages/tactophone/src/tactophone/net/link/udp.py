"""The only module of the link that uses a socket; a filter in the kernel drops foreign
datagrams before they cost time.

The filter is a program of classic BPF (Linux, ``man 7 socket``, SO_ATTACH_FILTER) over
the datagram with its UDP header of 8 bytes. It lets pass what may begin a handshake,
and of SRTP and SRTCP the peer's streams alone: their SSRC comes from the handshake, so
that nobody who cannot read the traffic guesses it. Whatever passes is authenticated as
before.
"""

import contextlib
import ctypes
import functools
import ipaddress
import select
import socket
import struct
import sys
from collections.abc import Collection, Iterable, Iterator, Sequence
from typing import Any

from tactophone.core.errors import DeviceError
from tactophone.net.link.packet import Address, is_dtls

_SO_ATTACH_FILTER = 26
"""Socket option that attaches a filter (``asm-generic/socket.h``)."""

_SO_DETACH_FILTER = 27
"""Socket option that takes the filter away (``asm-generic/socket.h``)."""

# The instructions of classic BPF that the filter uses (``linux/bpf_common.h``).

_LOAD_BYTE = 0x30
"""Load the byte at an offset: ``BPF_LD | BPF_B | BPF_ABS``."""

_LOAD_HALF = 0x28
"""Load two bytes at an offset: ``BPF_LD | BPF_H | BPF_ABS``."""

_LOAD_WORD = 0x20
"""Load four bytes at an offset: ``BPF_LD | BPF_W | BPF_ABS``."""

_AND = 0x54
"""Keep the bits of a mask: ``BPF_ALU | BPF_AND | BPF_K``."""

_JUMP = 0x05
"""Skip instructions in any case: ``BPF_JMP | BPF_JA``."""

_JUMP_EQUAL = 0x15
"""Compare with a constant: ``BPF_JMP | BPF_JEQ | BPF_K``."""

_JUMP_AT_LEAST = 0x35
"""Compare with the least of a range: ``BPF_JMP | BPF_JGE | BPF_K``."""

_RETURN = 0x06
"""End with the number of bytes to pass on: ``BPF_RET | BPF_K``."""

# Offsets, in bytes from the beginning of the UDP header, which has 8.

_FIRST_BYTE = 8
"""Offset of a datagram's first byte."""

_SECOND_BYTE = 9
"""Offset of a datagram's second byte."""

_SSRC_OF_RTCP = 12
"""Offset of the SSRC of an RTCP packet (RFC 3550 section 6.4)."""

_SSRC_OF_RTP = 16
"""Offset of the SSRC of an RTP packet (RFC 3550 section 5.1)."""

_DTLS_VERSION = 0xFE
"""First byte of every DTLS version; the second byte of a record."""

_WHOLE = 0xFFFF_FFFF
"""What the filter returns for a datagram that passes: all of its bytes."""

_NOTHING = 0
"""What the filter returns for a datagram that is dropped."""

UDP_HEADER = 8
"""Bytes before a datagram's own, which the filter counts too."""

Piece = tuple[int, bytes]
"""Bytes of a datagram, and where they begin in it."""

Instruction = tuple[int, int, int, int]
"""Code, instructions to skip if true and if false, and operand."""


def set_filter(
    target: socket.socket,
    streams: Collection[int],
    *,
    handshakes: bool = True,
    stun: bool = False,
) -> None:
    """Let DTLS (with ``handshakes``), STUN (with ``stun``, for the socket of a call)
    and the SSRCs ``streams`` alone pass to a UDP socket; everything without any SSRC.

    Where the system has no such filter, everything passes too: the session refuses the
    same datagrams, only later.
    """
    if streams:
        _attach(target, _program(sorted(streams), handshakes=handshakes, stun=stun))
    elif sys.platform == "linux":
        with contextlib.suppress(OSError):
            target.setsockopt(socket.SOL_SOCKET, _SO_DETACH_FILTER, 0)


def pass_only(target: socket.socket, beginnings: Iterable[Sequence[Piece]]) -> None:
    """Let pass to a UDP socket only datagrams that have all pieces of one of the
    ``beginnings``, where the system has such a filter.

    The bytes of a piece are a multiple of four.
    """
    program = list[Instruction]()
    for pieces in beginnings:
        words = [
            (UDP_HEADER + offset + at, int.from_bytes(piece[at : at + 4]))
            for offset, piece in pieces
            for at in range(0, len(piece), 4)
        ]
        for number, (offset, word) in enumerate(words, 1):
            program.append((_LOAD_WORD, 0, 0, offset))
            # What differs goes on behind this beginning's last instruction.
            program.append((_JUMP_EQUAL, 0, 2 * (len(words) - number) + 1, word))
        program.append((_RETURN, 0, 0, _WHOLE))
    _attach(target, [*program, (_RETURN, 0, 0, _NOTHING)])


def _attach(target: socket.socket, instructions: Iterable[Instruction]) -> None:
    if sys.platform != "linux":
        return
    # Two structures of the kernel, sock_filter and sock_fprog: it copies both during
    # the call.
    program = [struct.pack("HBBI", *each) for each in instructions]
    buffer = ctypes.create_string_buffer(b"".join(program))
    pointer = struct.pack("HP", len(program), ctypes.addressof(buffer))
    with contextlib.suppress(OSError):
        target.setsockopt(socket.SOL_SOCKET, _SO_ATTACH_FILTER, pointer)


def _program(
    streams: Collection[int],
    *,
    handshakes: bool,
    stun: bool = False,
) -> Iterator[Instruction]:
    """Yield the filter's instructions. A load beyond the end of a datagram drops it."""
    if stun:
        yield from _accept_stun()
    # Positions of instructions below, as a jump says how many to skip.
    rtp = 11
    compare = 12
    dtls = 13 + len(streams)
    drop = dtls + 2
    accept = dtls + 3
    handshake = dtls if handshakes else drop

    def skip(index: int, target: int) -> int:
        return target - index - 1

    # The first byte tells the protocols apart (RFC 7983 section 7): DTLS from 20 to 63,
    # SRTP and SRTCP from 128 to 191.
    yield (_LOAD_BYTE, 0, 0, _FIRST_BYTE)
    yield (_JUMP_AT_LEAST, 0, skip(1, drop), 20)
    yield (_JUMP_AT_LEAST, 0, skip(2, handshake), 64)
    yield (_JUMP_AT_LEAST, 0, skip(3, drop), 128)
    yield (_JUMP_AT_LEAST, skip(4, drop), 0, 192)
    # Of these, RTCP has 64 to 95 in the lower seven bits of its second byte (RFC 5761
    # section 4), as in `packet.is_report`. Its SSRC stands elsewhere than RTP's.
    yield (_LOAD_BYTE, 0, 0, _SECOND_BYTE)
    yield (_AND, 0, 0, 0x7F)
    yield (_JUMP_AT_LEAST, 0, skip(7, rtp), 64)
    yield (_JUMP_AT_LEAST, skip(8, rtp), 0, 96)
    yield (_LOAD_WORD, 0, 0, _SSRC_OF_RTCP)
    yield (_JUMP, 0, 0, skip(10, compare))
    yield (_LOAD_WORD, 0, 0, _SSRC_OF_RTP)
    # One comparison for each stream of the peer.
    for index, stream in enumerate(streams, compare):
        yield (_JUMP_EQUAL, skip(index, accept), 0, stream)
    yield (_JUMP, 0, 0, skip(dtls - 1, drop))
    # A record of DTLS has its version in the second byte.
    yield (_LOAD_BYTE, 0, 0, _SECOND_BYTE)
    yield (_JUMP_EQUAL, skip(dtls + 1, accept), skip(dtls + 1, drop), _DTLS_VERSION)
    yield (_RETURN, 0, 0, _NOTHING)
    yield (_RETURN, 0, 0, _WHOLE)


def _accept_stun() -> Iterator[Instruction]:
    """Let STUN pass: by its first byte (RFC 7983), its cookie, and a
    length in words of four bytes."""
    # Whatever does not begin like STUN skips all of this, to the instructions after it.
    yield (_LOAD_BYTE, 0, 0, _FIRST_BYTE)
    yield (_JUMP_AT_LEAST, 7, 0, END_OF_STUN)
    yield (_LOAD_WORD, 0, 0, _FIRST_BYTE + 4)
    yield (_JUMP_EQUAL, 0, 3, STUN_COOKIE)
    yield (_LOAD_HALF, 0, 0, _FIRST_BYTE + 2)
    yield (_AND, 0, 0, 3)
    yield (_JUMP_EQUAL, 1, 0, 0)
    yield (_RETURN, 0, 0, _NOTHING)
    yield (_RETURN, 0, 0, _WHOLE)


END_OF_STUN = 4
"""First byte from which a datagram is no STUN message any more (RFC 7983 section 7)."""

STUN_COOKIE = 0x2112A442
"""Bytes 4 to 7 of every STUN message (RFC 8489 section 5)."""

_LARGEST = 2_048
"""Bytes that a read takes of a datagram; a session's datagrams have at most 1,232."""

_MOST_AT_ONCE = 256
"""Maximum datagrams of one read: more than half a second of 2.5 ms packets."""

_QUEUE = 1 << 20
"""Bytes of a socket's queue, which holds what arrives while the process is late; the
system may grant less."""

MAX_FOREIGN = 16
"""Maximum datagrams of one read from anybody but the connected peer: 3,200 a second
where a read waits 5 ms."""

MAX_PEER_HANDSHAKES = 64
"""Maximum DTLS datagrams of one read from the address of the connected peer, which
anybody can forge. A handshake and its retransmissions during a stall of seconds are
fewer. What exceeds this is dropped, and DTLS that follows is dropped for a while too
(`CLOSED_READS`)."""

CLOSED_READS = 200
"""Number of reads for which the kernel then drops DTLS from that address. A read that
waits longer than `CLOSED_READ` counts several times, so that the pause takes about a
second both at an operator, to whom a packet comes every 5 ms, and at a robot, whose
reads wait 50 ms."""

CLOSED_READ = 0.005
"""Seconds of waiting that count as one of the `CLOSED_READS`."""

FOREIGN_TURNS = 4
"""Reads from one look at what others sent to the next, while the peer sends: 10 ms with
packets of 2.5 ms."""

_IP_PKTINFO = 8
"""Option and message that hold the address of this machine to which a datagram of IPv4
was sent (``man 7 ip``). Python has a name only for that of IPv6, which also tells of
IPv4 at a socket of both."""

_IN_PKTINFO = struct.Struct("=i4s4s")
"""Content of that message: interface, address to answer from, address sent to."""

_IN6_PKTINFO = struct.Struct("=16sI")
"""Content of the message of IPv6: address sent to, interface (RFC 3542 section 6)."""

_PKTINFO_SPACE = 64
"""Bytes for the largest of these messages, with its header."""

_MOST_CALLED = 2 * _MOST_AT_ONCE
"""Maximum callers of whom it is remembered which address they called: all of a read are
answered before the next one."""

Called = tuple[str, int]
"""An address of this machine as a socket has it, and its interface if it means
something there alone, else 0."""

_ANY = {socket.AF_INET6: "::", socket.AF_INET: "0.0.0.0"}
"""The address that stands for all addresses of a family."""

_MAPPED = "::ffff:"
"""How an IPv4 address begins that a socket of IPv6 uses (RFC 4291 section 2.5.5.2)."""

_EXPEDITED = 46 << 2
"""DSCP "expedited forwarding" (RFC 3246); Wi-Fi gives such packets the priority of
voice."""


def host_towards(targets: Sequence[Address]) -> str:
    """Return the address to send from: the loopback for targets on it, so that nobody
    on a network reaches the port; else all addresses, of which the route chooses.

    Targets on the loopback are of one family, as `resolve` returns them.
    """
    if not targets or not all(map(_is_loopback, targets)):
        return ""
    return "::1" if ":" in targets[0][0] else "127.0.0.1"


def _is_loopback(target: Address) -> bool:
    host, _, _ = target[0].partition("%")
    return ipaddress.ip_address(host).is_loopback


class UdpSocket(contextlib.AbstractContextManager["UdpSocket", None]):
    """UDP at one port, of IPv4, IPv6 or both; a context manager.

    While a peer is `follow`-ed, two sockets share the port. The system passes the
    peer's datagrams to the one that is connected to its address, and everybody else's
    to the first one. Each `receive` takes only a few from the first one, so that
    strangers can fill their own queue and not the peer's. A filter in both drops what
    belongs to no stream of the peer. Everything is sent through the first one.

    The source address follows the route, also when this machine gets another one. With
    ``answers`` it is instead the one that was called (Linux): a caller takes answers
    from nowhere else, and the route prefers another where a machine has both Ethernet
    and Wi-Fi, or addresses of IPv6 that change. To a peer that is followed it stays,
    whatever others send in its name.

    An empty ``host`` stands for all addresses of both families; port 0 lets the system
    choose. Raises `DeviceError` when this machine does not have the address, or when it
    is in use.
    """

    def __init__(self, host: str = "", port: int = 0, *, answers: bool = False) -> None:
        self._socket = _open(host, port)
        self._answers = answers and _tell_called(self._socket)
        self._called: dict[Address, Called] = {}
        self._peer_called: Called | None = None
        self._followed: tuple[Address, frozenset[int]] | None = None
        self._peer_socket: socket.socket | None = None
        self._peer_poll = select.poll()
        self._left: list[tuple[bytes, Address]] = []
        self._closed_reads = 0
        self._closed = False
        self._turns = 0
        self._way: tuple[Address | None, tuple[Any, ...], list[Any]] = None, (), []

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def address(self) -> Address:
        return _address(self._socket.getsockname())

    def fileno(self) -> int:
        """Return the file descriptor of the first socket, for ``select``."""
        return self._socket.fileno()

    def follow(self, remote: tuple[Address, frozenset[int]] | None) -> None:
        """Give the peer at this address, with these SSRCs, a socket of its own;
        ``None`` when there is no session."""
        if remote is self._followed or remote == self._followed:
            return
        # Another address takes another socket; the same one with renewed keys, only
        # another filter.
        before = self._followed
        self._followed = remote
        if remote is None or before is None or before[0] != remote[0]:
            self._peer_called = self._called.get(remote[0]) if remote else None
            self._connect(remote[0] if remote else None)
        self._closed_reads = 0
        self._closed = False
        for each in filter(None, (self._socket, self._peer_socket)):
            set_filter(each, remote[1] if remote else ())

    def receive(self, timeout: float) -> list[tuple[bytes, Address]]:
        """Return the datagrams received, each with its source, oldest first; wait up to
        ``timeout`` s for the first."""
        if self._peer_socket is None or self._followed is None:
            if timeout > 0 and not self._left:
                select.select([self._socket], [], [], timeout)
            datagrams = self._left
            self._left = []
            return datagrams + self._read_any(_MOST_AT_ONCE)
        if timeout > 0 and not self._left:
            self._peer_poll.poll(1000 * timeout)
        datagrams = self._left
        self._left = []
        datagrams += self._without_flood(
            self._read_peer(self._peer_socket, self._followed[0]), timeout
        )
        # Strangers wait while the peer's sound comes: a look at their queue takes as
        # long as a packet.
        self._turns += 1
        if datagrams and self._turns % FOREIGN_TURNS:
            return datagrams
        return datagrams + self._read_any(MAX_FOREIGN)

    def send(self, datagrams: Iterable[tuple[bytes, Address]]) -> int:
        """Send each without waiting; return how many the system refused."""
        refused = 0
        for datagram, target in datagrams:
            try:
                address, origin = self._way_to(target)
                self._socket.sendmsg([datagram], origin, 0, address)
            except OSError:
                refused += 1
                # An interface that was plugged in again has another number.
                self._forget_way()
        return refused

    def close(self) -> None:
        self._connect(None)
        self._socket.close()

    def _read_peer(
        self, source: socket.socket, peer: Address
    ) -> list[tuple[bytes, Address]]:
        """Read from the connected socket, whose datagrams all come from ``peer``."""
        datagrams: list[tuple[bytes, Address]] = []
        for _ in range(_MOST_AT_ONCE):
            try:
                datagrams.append((source.recv(_LARGEST), peer))
            except BlockingIOError:
                break
            except OSError:  # it concerns an earlier datagram, as in `_read`
                continue
            # Asking takes less than the exception of an empty queue, and nearly always
            # there is one datagram.
            if not self._peer_poll.poll(0):
                break
        return datagrams

    def _without_flood(
        self, datagrams: list[tuple[bytes, Address]], waited: float
    ) -> list[tuple[bytes, Address]]:
        """Drop handshakes from the peer's address where there are too many, here first
        and then in the kernel."""
        if self._closed_reads:
            self._closed_reads = max(
                0, self._closed_reads - max(1, round(waited / CLOSED_READ))
            )
            self._accept_handshakes(not self._closed_reads)
        if len(datagrams) <= MAX_PEER_HANDSHAKES:
            return datagrams
        handshakes = [each for each in datagrams if is_dtls(each[0])]
        if len(handshakes) <= MAX_PEER_HANDSHAKES:
            return datagrams
        self._closed_reads = CLOSED_READS
        self._accept_handshakes(False)
        others = [each for each in datagrams if not is_dtls(each[0])]
        return others + handshakes[:MAX_FOREIGN]

    def _accept_handshakes(self, accepted: bool) -> None:
        if accepted == self._closed and self._peer_socket and self._followed:
            self._closed = not accepted
            set_filter(self._peer_socket, self._followed[1], handshakes=accepted)

    def _read_any(self, most: int) -> list[tuple[bytes, Address]]:
        """Read from the first socket, and note which address was called."""
        if not self._answers:
            return _read(self._socket, most)
        datagrams: list[tuple[bytes, Address]] = []
        for _ in range(most):
            try:
                datagram, told, _, origin = self._socket.recvmsg(
                    _LARGEST, _PKTINFO_SPACE
                )
            except BlockingIOError:
                break
            except OSError:  # it concerns an earlier datagram, as in `_read`
                continue
            source = _address(origin)
            datagrams.append((datagram, source))
            for _, _, content in told:
                self._note_called(source, _called(content))
        return datagrams

    def _note_called(self, source: Address, called: Called) -> None:
        # The newest callers stand last.
        if self._called.pop(source, None) != called:
            self._forget_way()
        while len(self._called) >= _MOST_CALLED:
            del self._called[next(iter(self._called))]
        self._called[source] = called

    def _way_to(self, target: Address) -> tuple[tuple[Any, ...], list[Any]]:
        """Return an address for the socket, and from which one to send; the last ones
        are cached, because nearly everything goes to one peer."""
        if target is not self._way[0]:
            called = self._called.get(target)
            if self._followed and self._followed[0] == target:
                called = self._peer_called
            origin = [_origin(called, self._socket.family)] if called else []
            self._way = target, _socket_address(target, self._socket.family), origin
        return self._way[1:]

    def _forget_way(self) -> None:
        self._way = None, (), []

    def _connect(self, peer: Address | None) -> None:
        """Replace the peer's socket; without one, or if the system refuses it, the
        first one takes everything."""
        self._forget_way()
        if self._peer_socket:
            self._left += _read(self._peer_socket, _MOST_AT_ONCE)
            self._peer_socket.close()
            self._peer_socket = None
        if peer is not None:
            with contextlib.suppress(OSError):
                self._peer_socket = _share(self._socket, peer, self._peer_called)
                self._peer_poll = select.poll()
                self._peer_poll.register(self._peer_socket, select.POLLIN)


def resolve(host: str, port: int) -> list[Address]:
    """Resolve a host name to all its addresses, IPv6 and IPv4, in the system's order;
    `DeviceError` when that fails.

    Where all are on the loopback, as ``::1`` and ``127.0.0.1`` of ``localhost`` are,
    only those of IPv4 are returned, if there are any: no socket can be bound to both
    and to nothing else.
    """
    try:
        found = socket.getaddrinfo(host, port, type=socket.SOCK_DGRAM)
    except (OSError, UnicodeError) as error:
        # What is no name at all, such as one of over 63 letters, is a UnicodeError.
        reason = getattr(error, "strerror", None) or "no name of a machine"
        raise DeviceError(
            f"{host!r} cannot be resolved ({reason}); check link.peer"
        ) from error
    addresses = list(dict.fromkeys(_address(address) for *_, address in found))
    if all(map(_is_loopback, addresses)):
        return [each for each in addresses if ":" not in each[0]] or addresses
    return addresses


def _open(host: str, port: int) -> socket.socket:
    """Open and bind a socket; all addresses are one socket of IPv6 that takes IPv4 too,
    where there is IPv6."""
    families = [socket.AF_INET6 if ":" in host else socket.AF_INET]
    if not host:
        families = [socket.AF_INET6, socket.AF_INET]
    error = OSError()
    for family in families:
        opened = None
        try:
            opened = _socket(family, only=bool(host))
            opened.bind(_socket_address((host or _ANY[family], port), family))
        except OSError as refused:
            error = refused
            if opened:
                opened.close()
        else:
            return opened
    raise DeviceError(
        f"cannot listen at {host or '*'}:{port}: {error.strerror}; choose another "
        "with --set link.port=..."
    ) from error


def _socket(family: int, *, only: bool) -> socket.socket:
    opened = socket.socket(family, socket.SOCK_DGRAM)
    if family == socket.AF_INET6:
        opened.setsockopt(socket.IPPROTO_IPV6, socket.IPV6_V6ONLY, only)
    prepare(opened)
    return opened


def prepare(opened: socket.socket) -> None:
    """Never let a UDP socket wait; give it a large queue, and its packets the priority
    of voice."""
    opened.setblocking(False)
    opened.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, _QUEUE)
    # The link works without the priority, where a system does not support it.
    with contextlib.suppress(OSError):
        opened.setsockopt(socket.IPPROTO_IP, socket.IP_TOS, _EXPEDITED)
    with contextlib.suppress(OSError, AttributeError):
        opened.setsockopt(socket.IPPROTO_IPV6, socket.IPV6_TCLASS, _EXPEDITED)


def _share(first: socket.socket, peer: Address, called: Called | None) -> socket.socket:
    """Open a second socket at the port of ``first``, for one peer alone, which calls
    one address of this machine.

    Sharing is permitted for the time of the two calls only, so that no other program
    can ever take the port too.
    """
    only = first.family == socket.AF_INET6 and bool(
        first.getsockopt(socket.IPPROTO_IPV6, socket.IPV6_V6ONLY)
    )
    second = _socket(first.family, only=only)
    try:
        for each in (first, second):
            each.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEPORT, 1)
        own = first.getsockname()
        if called:
            # Connected without that, it would take the address that the route prefers.
            own = (called[0], own[1], *((0, called[1]) if called[1] else ()))
        second.bind(own)
        second.connect(_socket_address(peer, first.family))
    except (OSError, AttributeError):
        second.close()
        raise
    finally:
        first.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEPORT, 0)
    second.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEPORT, 0)
    return second


def _tell_called(target: socket.socket) -> bool:
    """Let the system say to which address of this machine each datagram was sent;
    return whether it does."""
    if sys.platform != "linux":
        return False
    option = socket.IPPROTO_IP, _IP_PKTINFO
    if target.family == socket.AF_INET6:
        option = socket.IPPROTO_IPV6, socket.IPV6_RECVPKTINFO
    target.setsockopt(*option, 1)
    return True


@functools.lru_cache(maxsize=64)  # a machine has few addresses
def _called(content: bytes) -> Called:
    """Return the address of this machine in what the system says of a datagram."""
    if len(content) == _IN_PKTINFO.size:
        _, own, _ = _IN_PKTINFO.unpack(content)
        return socket.inet_ntop(socket.AF_INET, own), 0
    own, interface = _IN6_PKTINFO.unpack(content)
    host = socket.inet_ntop(socket.AF_INET6, own)
    return host, interface if ipaddress.IPv6Address(own).is_link_local else 0


def _origin(called: Called, family: int) -> tuple[int, int, bytes]:
    """Return the message that lets the system send from an address of this machine."""
    host, interface = called
    if family == socket.AF_INET:
        own = socket.inet_pton(socket.AF_INET, host)
        content = _IN_PKTINFO.pack(interface, own, bytes(4))
        return socket.IPPROTO_IP, _IP_PKTINFO, content
    own = socket.inet_pton(socket.AF_INET6, host)
    content = _IN6_PKTINFO.pack(own, interface)
    return socket.IPPROTO_IPV6, socket.IPV6_PKTINFO, content


def _read(source: socket.socket, most: int) -> list[tuple[bytes, Address]]:
    datagrams: list[tuple[bytes, Address]] = []
    # An error concerns an earlier datagram, which reached a closed port; the next may
    # succeed.
    for _ in range(most):
        try:
            datagram, origin = source.recvfrom(_LARGEST)
        except BlockingIOError:
            break
        except OSError:
            continue
        datagrams.append((datagram, _address(origin)))
    return datagrams


def _address(address: tuple[Any, ...]) -> Address:
    """Return host and port; an IPv4 address that a socket of IPv6 reports as
    ``::ffff:192.0.2.1`` in its usual form, and a link-local one with its interface."""
    host = str(address[0])
    if interface := _interface(address):
        return f"{host.partition('%')[0]}%{interface}", int(address[1])
    return host.removeprefix(_MAPPED) if "." in host else host, int(address[1])


def _interface(address: tuple[Any, ...]) -> str:
    """Return the interface on which an address means something; empty for any other
    address."""
    number = address[3] if len(address) > 3 else 0
    if not number:
        return ""
    try:
        return socket.if_indextoname(number)
    except OSError:  # it has gone
        return str(number)


def _socket_address(address: Address, family: int) -> tuple[Any, ...]:
    host, port = address
    if family == socket.AF_INET6 and ":" not in host:
        return _MAPPED + host, port
    if "%" in host:  # a link-local address, which means something on one interface only
        host, _, interface = host.partition("%")
        number = int(interface) if interface.isdecimal() else 0
        return host, port, 0, number or socket.if_nametoindex(interface)
    return host, port
