"""The one file of the link that touches a socket."""

import contextlib
import select
import socket
from collections.abc import Iterable
from types import TracebackType
from typing import Protocol, Self, TypeAlias

from tactophone.errors import DeviceError

Endpoint: TypeAlias = tuple[str, int]
"""Host and port, as the socket takes and gives them."""

_LARGEST = 2_048
_MOST_AT_ONCE = 256
"""Datagrams fetched in one go: over half a second of 2.5 ms packets, more than is ever worth having."""

_EXPEDITED = 46 << 2
"""Differentiated services "expedited forwarding" (RFC 3246); Wi-Fi sends such packets as voice."""


class DatagramSocket(Protocol):
    """Sends and fetches datagrams; all that a runtime needs of a network."""

    @property
    def address(self) -> Endpoint:
        """Where others reach it."""
        ...

    def receive(self, timeout: float) -> list[tuple[bytes, Endpoint]]:
        """Fetch whatever has come, with its origin, oldest first; waits for ``timeout`` seconds when nothing has."""
        ...

    def send(self, datagrams: Iterable[tuple[bytes, Endpoint]]) -> int:
        """Send each, without ever waiting; returns how many the system did not take."""
        ...

    def close(self) -> None:
        """Free the port."""
        ...


class UdpSocket:
    """The network, as a context manager.

    Parameters
    ----------
    host, port
        Where to listen; port 0 lets the system choose one.

    Raises
    ------
    DeviceError
        When the address is not ours, or is taken.
    """

    def __init__(self, host: str = "0.0.0.0", port: int = 0) -> None:
        family = socket.AF_INET6 if ":" in host else socket.AF_INET
        self._socket = socket.socket(family, socket.SOCK_DGRAM)
        self._socket.setblocking(False)
        with contextlib.suppress(OSError):  # no harm where a system does not know the mark
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

    def __exit__(
        self, kind: type[BaseException] | None, error: BaseException | None, trace: TracebackType | None
    ) -> None:
        self.close()

    @property
    def address(self) -> Endpoint:
        """Where others reach it."""
        host, port, *_ = self._socket.getsockname()
        return host, port

    def fileno(self) -> int:
        """For ``select``, beside other things to wait for."""
        return self._socket.fileno()

    def receive(self, timeout: float) -> list[tuple[bytes, Endpoint]]:
        """Fetch whatever has come, with its origin, oldest first; waits for ``timeout`` seconds when nothing has."""
        if timeout > 0:
            select.select([self._socket], [], [], timeout)
        datagrams: list[tuple[bytes, Endpoint]] = []
        while len(datagrams) < _MOST_AT_ONCE:
            try:
                datagram, origin = self._socket.recvfrom(_LARGEST)
            except BlockingIOError:
                break
            except OSError:
                continue  # a past datagram met a closed port; it says nothing of the next
            datagrams.append((datagram, (origin[0], origin[1])))
        return datagrams

    def send(self, datagrams: Iterable[tuple[bytes, Endpoint]]) -> int:
        """Send each, without ever waiting; returns how many the system did not take."""
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
    """Look a host's name up; `DeviceError` when nobody knows it."""
    try:
        *_, address = socket.getaddrinfo(host, port, type=socket.SOCK_DGRAM)[0]
    except OSError as error:
        raise DeviceError(f"{host!r} is not a host that can be found ({error.strerror}); check link.peer") from error
    return str(address[0]), int(address[1])
