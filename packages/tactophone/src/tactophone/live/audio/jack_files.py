"""What JACK 2 keeps in ``/dev/shm``, and how to keep clear of its faults (Linux).

Every client opens a database there before it looks for its server, and makes it if
there is none. A server deletes it when it ends, some 20 ms after its socket. A client
that comes in between leaves a part of a database behind. On that part it crashes
(SIGBUS), and so do all later clients and servers of the user, until somebody deletes
it (measured with 1.9.21: 2 crashes in 114 ends of a server, beside a client that tried
without a pause). So a client looks for the server's socket first (`has_socket`), and
what would crash is named instead (`damage`).

PipeWire and JACK 1 have no such database.
"""

import os
import sys
import time
from pathlib import Path

from tactophone.core.errors import DeviceError
from tactophone.live.audio.jack_binding import jack_module

_FOLDER = Path("/dev/shm")

_DATABASE = ("__db.001", "__db.002", "__db.003", "metadata.db")
"""Files of a whole database, as Berkeley DB 5.3 makes them."""

_LOOKS = 3
"""Looks before a database counts as damaged: it is made and deleted in 1 ms."""

_BETWEEN_LOOKS = 0.02
"""Seconds."""


def has_socket(server: str) -> bool:
    """Return whether a server may be there, by its socket; the empty name is libjack's
    default. A server that was killed leaves its socket behind."""
    if not _is_jack2() or sys.platform != "linux":
        return True
    if "JACK_PROMISCUOUS_SERVER" in os.environ:
        return True  # the socket is named otherwise
    name = server or os.environ.get("JACK_DEFAULT_SERVER") or "default"
    return (_FOLDER / f"jack_{name}_{os.getuid()}_0").is_socket()


def damage() -> str:
    """Return in words that every JACK program would crash now, or an empty text."""
    if not _is_jack2() or sys.platform != "linux":
        return ""
    folder = _FOLDER / f"jack_db-{os.getuid()}"
    for look in range(_LOOKS):
        try:
            sizes = {entry.name: entry.stat().st_size for entry in os.scandir(folder)}
        except OSError:
            return ""
        if not sizes or all(sizes.get(name) for name in _DATABASE):
            return ""
        if look < _LOOKS - 1:
            time.sleep(_BETWEEN_LOOKS)
    return (
        f"JACK's database in {folder} is damaged, and every JACK program crashes on "
        "it, jackd too: end those that run, and delete that folder"
    )


def _is_jack2() -> bool:
    try:
        return bool(jack_module().version_string().startswith("1."))
    except DeviceError:
        return True  # PortAudio may use libjack without the binding
