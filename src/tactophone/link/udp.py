"""The only module of the link that uses a socket."""

import contextlib
import select
import socket
from collections.abc import Iterable
from typing import Protocol, Self, TypeAlias

from tactophone.errors import DeviceError

Endpoint: TypeAlias = tuple[str, int]
"""Host and port, as the socket expects and returns them."""

_LARGEST = 2_048
_MOST_AT_ONCE = 256
"""Maximum datagrams of one read: more than half a second of 2.5 ms packets."""

_EXPEDITED = 46 << 2
"""DSCP "expedited forwarding" (RFC 3246); Wi-Fi gives such packets the priority of voice."""


class DatagramSocket(Protocol):
    """Sends and receives datagrams; all that the runtime needs of a network."""

    @property
    def address(self) -> Endpoint:
        """Local host and port."""

    def receive(self, timeout: float) -> list[tuple[bytes, Endpoint]]:
        """Return the datagrams received, each with its source, oldest first; wait up to ``timeout`` s for the first."""

    def send(self, datagrams: Iterable[tuple[bytes, Endpoint]]) -> int:
        """Send each without waiting; return how many the system refused."""

    def close(self) -> None:
        """Free the port."""


class UdpSocket:
    """A UDP socket; a context manager.

    Parameters
    ----------
    host, port
        Local address; port 0 lets the system choose.

    Raises
    ------
    DeviceError
        When the address is not of this machine, or is in use.
    """

    def __init__(self, host: str = "0.0.0.0", port: int = 0) -> None:
        family = socket.AF_INET6 if ":" in host else socket.AF_INET
        self._socket = socket.socket(family, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        with contextlib.suppress(OSError):  # works without, where a system does not support it
            self._socket.setsockopt(socket.IPPROTO_IP, socket.IP_TOS, _EXPEDITED)
        try:
            self._socket.bind((host, port))
        except OSError as error:
            self._socket.close()
            raise DeviceError(
                f"cannot listen at {host}:{port}: {error.strerror}; choose another with --set link.port=..."
            ) from error

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    @property
    def address(self) -> Endpoint:
        """Local host and port."""
        host, port, *_ = self._socket.getsockname()
        return host, port

    def fileno(self) -> int:
        """Return the file descriptor, for ``select``."""
        return self._socket.fileno()

    def receive(self, timeout: float) -> list[tuple[bytes, Endpoint]]:
        """Return the datagrams received, each with its source, oldest first; wait up to ``timeout`` s for the first."""
        if timeout > 0:
            select.select([self._socket], [], [], timeout)
        datagrams: list[tuple[bytes, Endpoint]] = []
        while len(datagrams) < _MOST_AT_ONCE:
            try:
                datagram, origin = self._socket.recvfrom(_LARGEST)
            except BlockingIOError:
                break
            except OSError:
                continue  # an earlier datagram reached a closed port; the next may succeed
            datagrams.append((datagram, (origin[0], origin[1])))
        return datagrams

    def send(self, datagrams: Iterable[tuple[bytes, Endpoint]]) -> int:
        """Send each without waiting; return how many the system refused."""
        refused = 0
        for datagram, target in datagrams:
            try:
                self._socket.sendto(datagram, target)
            except OSError:
                refused += 1
        return refused

    def close(self) -> None:
        """Free the port."""
        self._socket.close()


def resolve(host: str, port: int) -> Endpoint:
    """Resolve a host name; `DeviceError` when that fails."""
    try:
        *_, address = socket.getaddrinfo(host, port, type=socket.SOCK_DGRAM)[0]
    except OSError as error:
        raise DeviceError(f"{host!r} cannot be resolved ({error.strerror}); check link.peer") from error
    return str(address[0]), int(address[1])
