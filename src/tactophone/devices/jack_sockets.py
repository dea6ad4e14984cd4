"""Disconnects another process from its JACK server, from outside and without its help (Linux).

The server repeats the last period of a client that stands still. It cannot be disconnected port by port meanwhile: the
server would wait for the client to take note (measured, jackd 1.9.21). So its *sockets* to the server are shut down, as
the system does when a process dies: the server removes the client and its ports, silent after 6 to 20 ms. A client that
goes on later finds its server gone, and joins it again (`tactophone.devices.JackClient.revive`).
"""

import contextlib
import ctypes
import os
import socket
import sys

_PIDFD_GETFD = 438
"""Number of the system call (Linux 5.6), the same on all architectures; Python 3.11 has no function for it."""

_SOCKET_NAME = "/jack_"
"""In the paths of all sockets between jackd and its clients, as in ``/dev/shm/jack_default_0_0``."""


def disconnect_from_jack(pid: int, *, client: str = "") -> bool:
    """Shut down the JACK sockets of a process; returns whether there were any that could be shut down.

    The process must be of the same user, and this one or a child of it. If it was stopped in the middle of its
    callback, it may later write the rest of one period into memory that is another client's by then. With ``client`` it
    shuts down only the sockets on which the server notifies the client of this name.
    """
    if sys.platform != "linux":
        return False
    marker = f"{_SOCKET_NAME}{client}_" if client else _SOCKET_NAME
    done = False
    with contextlib.suppress(OSError):
        process = os.pidfd_open(pid)
        try:
            for name in os.listdir(f"/proc/{pid}/fd"):
                with contextlib.suppress(OSError):  # closed meanwhile, or not connected
                    done |= _shut_down(process, int(name), f"/proc/{pid}/fd/{name}", marker)
        finally:
            os.close(process)
    return done


def _shut_down(process: int, descriptor: int, link: str, marker: str) -> bool:
    """Shut down one descriptor of a process, if it is a socket of JACK."""
    if not os.readlink(link).startswith("socket:"):
        return False
    copy = ctypes.CDLL(None).syscall(_PIDFD_GETFD, process, descriptor, 0)
    if copy < 0:
        return False
    with socket.socket(fileno=copy) as shared:
        if shared.family != socket.AF_UNIX or shared.type != socket.SOCK_STREAM:
            return False
        if not any(marker in str(name) for name in (shared.getsockname(), shared.getpeername())):
            return False
        shared.shutdown(socket.SHUT_RDWR)
    return True
