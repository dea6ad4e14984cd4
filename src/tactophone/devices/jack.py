"""JACK clients that outlive their server.

How JACK fails was measured (docs/guide/hardware.md) and explains this file. A process callback that raises is never
called again, without a message: so no exception may leave it. A server that ends calls back once and leaves a client
that returns stale values: so that client is discarded, and a new one made when the server is back. The last period of a
client that *stalls* is repeated for ever: only another process can help, see :mod:`tactophone.runtime.watchdog`. A
client that leaves stops reading what the server sends; where more than 0.2 MB of it waits, as after a second of xruns,
the server waits for the client and the client for the server: so leaving has a time limit. Its
callback stops before it leaves, see `Leaving`.
"""

import contextlib
import ctypes
import faulthandler
import functools
import os
import socket
import sys
import threading
import time
from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, field
from typing import IO, Any

import numpy as np

from tactophone.devices.device import Process
from tactophone.errors import DeviceError
from tactophone.types import FloatArray

_ABANDONED: list[Any] = []
"""Clients of dead servers, and those that could not leave: kept, as libjack's threads may still call back into them."""

_LEAVING_LIMIT = 0.5
"""Seconds to wait for the server when a client leaves; a server in order answers within milliseconds."""

CALLBACK_LIMIT = 0.1
"""Seconds to wait for the next callback of a client that leaves; none comes where the server has let it go."""

RETURN_TIME = 0.01
"""Seconds in which a callback that has nothing to do returns to libjack."""

THREAD_LIMIT = 0.5
"""Seconds to wait for a late callback, and for the end of its thread."""

_DEAD_AFTER = 2.0
"""Seconds of a close after which the process ends: libjack has cancelled a thread in Python, and nobody can go on."""

_PIDFD_GETFD = 438
"""Number of the system call (Linux 5.6), the same on all architectures; Python 3.11 has no function for it."""

_SOCKET_NAME = "/jack_"
"""In the paths of all sockets between jackd and its clients, as in ``/dev/shm/jack_default_0_0``."""


@dataclass(frozen=True, slots=True)
class JackPort:
    """A port of the JACK graph; ``is_output``: whether it delivers sound."""

    name: str
    is_output: bool
    physical: bool


@dataclass(slots=True)
class Leaving:
    """Whether a client is about to leave, and whether its callback has seen that.

    libjack 1.9.21 cancels the thread of a client that is closed, and that of a lost one when the next joins
    (``CheckContext``), wherever it is. In the middle of Python, or waiting for it, it would keep the interpreter's lock
    for ever. So the callback of a client that leaves does nothing, and where the interpreter is late, as beside other
    busy threads, the thread ends by itself before the client is closed.
    """

    asked: bool = False
    ends: bool = False
    thread: int = 0
    seen: threading.Event = field(default_factory=threading.Event)

    def ask(self, *, lost: bool) -> bool:
        """Have the callback do nothing more; return whether its thread is out of Python, and the client may be closed.

        The thread of a ``lost`` client ends.
        """
        self.ends, self.asked = lost, True
        answered, began = self.seen.wait(CALLBACK_LIMIT), time.monotonic()
        time.sleep(RETURN_TIME)
        late = time.monotonic() - began > 1.5 * RETURN_TIME
        if not (lost or late):
            return True  # a server that does not call has no thread in Python
        # Not always: a synchronous server would wait 50 ms for a client whose thread ends.
        self.ends = True
        if not answered and not (late and self.seen.wait(THREAD_LIMIT)):
            return False
        until = time.monotonic() + THREAD_LIMIT
        while (runs := os.path.exists(f"/proc/self/task/{self.thread}")) and time.monotonic() < until:
            time.sleep(RETURN_TIME)
        time.sleep(RETURN_TIME)
        return not runs

    def answer(self, outputs: Iterable[FloatArray]) -> bool:
        """Silence the outputs, in the callback; returns whether its thread is to end."""
        for output in outputs:
            output[:] = 0.0
        self.thread = threading.get_native_id()
        self.seen.set()
        return self.ends


class JackClient:
    """A JACK client with named ports, each connected to another client's port or left free.

    Parameters
    ----------
    name
        Its name in the JACK graph.
    process
        Called each period; see `tactophone.devices.device.Process`.
    inputs, outputs
        Names of the client's ports, each with the port to connect it to; an empty text leaves it free.
    server
        The JACK server's name; empty for the default one.
    """

    def __init__(
        self, name: str, process: Process, *, inputs: Mapping[str, str], outputs: Mapping[str, str], server: str = ""
    ) -> None:
        self.xruns = self.process_faults = self.losses = 0
        self._name, self._process, self._server = name, process, server
        self._targets = {**inputs, **outputs}
        self._inputs, self._outputs = list(inputs), list(outputs)
        self._client: Any = None
        self._leaving = Leaving()
        self._lost = False
        self._rate = 0
        self._other_rate = self._unconnected = ""
        self._reconnect = True

    @property
    def sample_rate(self) -> int:
        """In Hz; 0 while there is no server."""
        return int(self._client.samplerate) if self._client else 0

    @property
    def period(self) -> int:
        """Samples per period; 0 while there is no server."""
        return int(self._client.blocksize) if self._client else 0

    @property
    def latency(self) -> float:
        """Seconds of one period; 0 while there is no server."""
        return self.period / self.sample_rate if self.sample_rate else 0.0

    @property
    def fault(self) -> str:
        """What is wrong now; empty when nothing is."""
        if self._lost or self._client is None:
            return f"{self._named()} is gone: start it again, and the client reconnects"
        return self._other_rate or self._unconnected

    def open(self) -> None:
        """Join the graph and connect the ports.

        Raises `DeviceError` when there is no server, or a port to connect to does not exist.
        """
        jack = _jack()
        self._rate = 0
        try:
            self._join(jack)
        except jack.JackError:
            self.close()
            raise DeviceError(
                "PipeWire does not answer: start it (`systemctl --user start pipewire`), or choose portaudio"
                if is_pipewire()
                else f"no JACK server {self._server}".rstrip()
                + ": start one, such as `jackd -R -d alsa -r 48000 -p 128`; on PipeWire `pw-jack tactophone ...`, "
                "or choose portaudio"
            ) from None
        self._connect_ports()
        if self._unconnected:
            unconnected = self._unconnected
            self.close()
            raise DeviceError(unconnected)

    def revive(self) -> None:
        """Join again if the server was lost, and connect again what is not connected.

        A successor of another sample rate is a fault, and the client takes no part in it: it would render other
        frequencies, and read others.
        """
        if self._lost:
            self._abandon()
        with contextlib.suppress(_jack().JackError):
            if self._client is None:
                self._join(_jack())
            if self._reconnect:
                self._connect_ports()

    def close(self) -> None:
        if self._lost:
            self._abandon()
        client, self._client = self._client, None
        if client is None:
            return
        closing = threading.Thread(target=client.close, daemon=True)
        # Of another rate, it was never activated, and has no callback.
        if may_close := bool(self._other_rate) or self._leaving.ask(lost=False):
            faulthandler.dump_traceback_later(_DEAD_AFTER, exit=True, file=_nowhere())
            closing.start()
            closing.join(_LEAVING_LIMIT)
            faulthandler.cancel_dump_traceback_later()
        if not may_close or closing.is_alive():
            # A server that is blocked in writing to this client goes on once the client's sockets are closed.
            disconnect_from_jack(os.getpid(), client=client.name)
            if may_close:
                closing.join(_LEAVING_LIMIT)
        if not may_close or closing.is_alive():
            self._keep(client)
        self._lost = False

    def ports(self) -> list[JackPort]:
        """All ports of the graph except this client's, physical ones first."""
        own = f"{self._client.name}:"
        ports = [
            JackPort(port.name, is_output=port.is_output, physical=port.is_physical)
            for port in self._client.get_ports(is_audio=True)
            if not port.name.startswith(own)
        ]
        return sorted(ports, key=lambda port: not port.physical)

    def _join(self, jack: Any) -> None:
        client = jack.Client(self._name, servername=self._server or None, no_start_server=True)
        for name in self._inputs:
            client.inports.register(name)
        for name in self._outputs:
            client.outports.register(name)
        # Each client has its own: the callback of one that left may still look at the old.
        self._leaving = Leaving()
        inputs, outputs = _Arrays(jack, client.inports), _Arrays(jack, client.outports)
        client.set_process_callback(self._cycle(inputs, outputs, self._leaving))
        client.set_xrun_callback(self._on_xrun)
        client.set_shutdown_callback(self._on_shutdown)
        # Polling the connections of a port would do too, but crashes when the server dies meanwhile.
        client.set_port_connect_callback(self._on_connect)
        self._client, self._rate = client, self._rate or client.samplerate
        self._reconnect = client.samplerate == self._rate
        self._other_rate = (
            ""
            if self._reconnect
            else (
                f"{self._named()} runs at {client.samplerate} Hz now, but {self._rate} Hz is needed: "
                + (
                    f"`pw-metadata -n settings 0 clock.force-rate {self._rate}` sets that"
                    if is_pipewire()
                    else f"start it with that rate (jackd ... -r {self._rate})"
                )
            )
        )
        if self._reconnect:
            client.activate()

    def _abandon(self) -> None:
        """Discard the client of a dead server: closing it crashes once a new server has taken over its memory."""
        self._leaving.ask(lost=True)
        self._keep(self._client)
        self._client, self._lost = None, False

    def _keep(self, client: Any) -> None:
        client._ptr = _jack()._ffi.NULL  # otherwise the binding closes it at garbage collection
        _ABANDONED.append(client)

    def _cycle(self, inputs: "_Arrays", outputs: "_Arrays", leaving: Leaving) -> Callable[[int], None]:
        def cycle(size: int) -> None:
            if leaving.asked:
                if leaving.answer(outputs.now(size)):
                    raise _jack().CallbackExit
                return
            try:
                self._process(inputs.now(size), outputs.now(size))
            except Exception:  # JACK must not see any exception: it would never call again
                self.process_faults += 1
                for output in outputs.now(size):
                    output[:] = 0.0

        return cycle

    def _connect_ports(self) -> None:
        self._unconnected, self._reconnect = "", False
        for port in (*self._client.inports, *self._client.outports):
            target = self._targets[port.shortname]
            if target and not port.connections:
                self._connect(port, target)

    def _connect(self, port: Any, target: str) -> None:
        ends = (target, port) if port.is_input else (port, target)
        try:
            self._client.connect(*ends)
        except _jack().JackError:
            candidates = [other.name for other in self.ports() if other.is_output == port.is_input]
            self._unconnected = (
                f"{port.name}: there is no JACK port {target} to connect to; there are "
                f"{', '.join(candidates) or 'none'}: choose one in the settings"
            )
            self._reconnect = True

    def _on_xrun(self, _: float) -> None:
        self.xruns += 1

    def _on_connect(self, _source: Any, _target: Any, connected: bool) -> None:
        self._reconnect |= not connected

    def _on_shutdown(self, _status: Any, _reason: str) -> None:
        self._lost = True
        self.losses += 1

    def _named(self) -> str:
        return "PipeWire" if is_pipewire() else f"the JACK server {self._server}".rstrip()


class _Arrays:
    """The sound of some ports as arrays, in each period.

    A port has one of a few buffers, which JACK names anew in each period. The array of a buffer is made once: the
    binding's own call makes it each time and takes six times as long.
    """

    def __init__(self, jack: Any, ports: Iterable[Any]) -> None:
        self._ports, self._ffi = [port._ptr for port in ports], jack._ffi
        self._buffer_of = jack._lib.jack_port_get_buffer
        self._arrays: dict[Any, FloatArray] = {}

    def now(self, size: int) -> list[FloatArray]:
        """Return an array of ``size`` samples for each port; call it in the process callback only."""
        found = []
        for port in self._ports:
            buffer = self._buffer_of(port, size)
            array = self._arrays.get(buffer)
            if array is None or len(array) != size:
                array = self._arrays[buffer] = np.frombuffer(self._ffi.buffer(buffer, 4 * size), np.float32)
            found.append(array)
        return found


@functools.cache
def _jack() -> Any:
    """Import the JACK binding, which needs an extra and the system library, and silence the library's messages.

    Once: a second call would free the functions of the first, which a thread of the library may be calling.
    """
    try:
        import jack
    except ImportError:
        raise DeviceError(
            "JACK-Client is not installed: `pip install 'tactophone[jack]'`, or choose portaudio"
        ) from None
    except OSError:
        raise DeviceError("libjack is not installed: `apt install jackd2`, or choose portaudio") from None
    jack.set_error_function(_ignore)
    jack.set_info_function(_ignore)
    return jack


def is_pipewire() -> bool:
    """Whether its libjack is loaded in place of jackd's, as by ``pw-jack``."""
    return "PipeWire" in _jack().version_string()


@functools.cache
def _nowhere() -> IO[str]:
    return open(os.devnull, "w")  # stays open, for a report that nobody could read


def _ignore(_: str) -> None:
    """Discard a message of libjack; errors arrive as exceptions too."""


def silent(_: list[FloatArray], outputs: list[FloatArray]) -> None:
    """Write silence: a process for clients that only inspect the graph."""
    for output in outputs:
        output[:] = 0.0


def disconnect_from_jack(pid: int, *, client: str = "") -> bool:
    """Disconnect another process from its JACK server, without its help (Linux); returns whether that could be done.

    The server repeats the last period of a client that stands still. It cannot be disconnected port by port meanwhile:
    the server would wait for the client to take note (measured, jackd 1.9.21). So its *sockets* to the server are shut
    down, as the system does when a process dies: the server removes the client and its ports, silent after 6 to 20 ms.
    A client that goes on later finds its server gone, and joins it again (`JackClient.revive`).

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
