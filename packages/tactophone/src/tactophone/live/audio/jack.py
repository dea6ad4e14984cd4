"""JACK clients that outlive their server.

How JACK fails was measured (docs/research/attack.md) and explains this file. A process
callback that raises is never called again, without a message: so no exception may leave
it. A server calls back once on shutdown; afterwards the client returns stale values: so
that client is closed, and a new one made when the server is back. The last period of a
client that *stalls* is repeated for ever: only another process can help, see
:mod:`tactophone.live.runtime.watchdog`.

libjack 1.9.21 cancels the threads of a client that it closes, asynchronously: in the
middle of Python, or waiting for its lock, a thread would keep that lock for ever, or
crash. So its second thread, which reads what the server tells, never enters Python
(`_Counter`), and its first, which calls the process, ends by itself before the client
is closed (`_leave`). After a loss, the next client of the process would close all
others: so they are closed first.
"""

import contextlib
import ctypes
import os
import socket
import sys
import threading
import time
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from tactophone.core.errors import DeviceError
from tactophone.live.audio.device import SILENT_AFTER, Process
from tactophone.live.audio.jack_binding import (
    PortArrays,
    address,
    handle_of,
    jack_module,
    keep_with,
    library,
)
from tactophone.live.audio.jack_files import damage, has_socket
from tactophone.signal.haptics.oscillator import COMMAND_STALE_AFTER

_OPEN: set["JackClient"] = set()
"""Clients of this process; kept until they are closed, as the binding would close them
at garbage collection."""

_LEAVING: list[threading.Thread] = []
"""Threads that close clients, and go on where a server does not answer in time."""

_LEAVING_LIMIT = 0.7
"""Seconds to wait for a client to leave; a server in order lets it go within some
periods."""

_CHECK_INTERVAL = 0.01
"""Seconds between two looks at the thread of a client that leaves."""

_QUIET_CHECKS = 5
"""Looks in a row that find the thread of a lost client outside Python: the server has
let it go after 6 to 20 ms."""

_FUTEX_PRIVATE = 128
"""Flag in a wait for memory of this process alone, as for Python's lock; JACK's is
shared with the server."""

_PIDFD_GETFD = 438
"""Number of the system call (Linux 5.6), the same on all architectures; Python 3.11 has
no function for it."""

_SOCKET_NAME = "/jack_"
"""Part of the path of every socket between jackd and its clients, as in
``/dev/shm/jack_default_0_0``."""


@dataclass(frozen=True, slots=True)
class JackPort:
    """A port of the JACK graph; ``is_output``: whether it delivers sound."""

    name: str
    is_output: bool
    physical: bool


class _Counter:
    """Counts calls of libjack by a function of the C library, without Python and its
    lock."""

    def __init__(self) -> None:
        # As long as a semaphore, which begins with its value.
        self._memory = (ctypes.c_int64 * 4)()

    @property
    def value(self) -> int:
        return self._memory[0] & 0xFFFF_FFFF

    def count(self, client: Any, registration: str) -> None:
        """Count what libjack calls back for a client; ``registration`` is libjack's
        function that registers it."""
        on_macos = sys.platform == "darwin"
        increment = address("OSAtomicIncrement32" if on_macos else "sem_post")
        register = getattr(library(), registration)
        register(handle_of(client), increment, self._memory)
        keep_with(client, self)


class JackClient:
    """A JACK client with named ports, each connected to another client's port or left
    free.

    - ``name``: its name in the JACK graph.
    - ``process``: called each period, see `tactophone.live.audio.device.Process`;
      ``None`` for a client that only inspects the graph.
    - ``inputs``, ``outputs``: names of the client's ports, each with the port to
      connect it to; an empty text leaves it free.
    - ``server``: the JACK server's name; empty for the default one.
    """

    def __init__(
        self,
        name: str,
        process: Process | None,
        *,
        inputs: Mapping[str, str],
        outputs: Mapping[str, str],
        server: str = "",
    ) -> None:
        self.process_faults = 0
        self._name = name
        self._process = process
        self._server = server
        self._targets = {**inputs, **outputs}
        self._inputs = list(inputs)
        self._outputs = list(outputs)
        self._cards = dict[str, str]()
        """What each connected port belonged to, see `_card_of`."""
        self._client: Any = None
        self._cycle: _Cycle | None = None
        self._xruns = _Counter()
        self._changes = _Counter()
        self._shutdowns = _Counter()
        self._connected_at = 0
        self._losses = 0
        self._rate = 0
        self._unconnected = ""

    @property
    def xruns(self) -> int:
        return self._xruns.value

    @property
    def losses(self) -> int:
        return self._losses + self._left

    @property
    def lost(self) -> bool:
        return self._client is None or self._left

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
        if self.lost:
            return f"{self._named()} is gone: start it again, and the client reconnects"
        if self._cycle and time.monotonic() - self._cycle.called_at > SILENT_AFTER:
            return (
                f"{self._named()} stands still: "
                "if it stays so, start it again, and the client reconnects"
            )
        return self._other_rate() or self._unconnected or self._long_period()

    def open(self) -> None:
        """Join the graph and connect the ports.

        Raises `DeviceError` when there is no server, a port to connect to does not
        exist, or libjack would crash.
        """
        jack = jack_module()
        if damaged := damage():
            raise DeviceError(damaged)
        self._rate = 0
        try:
            self._join(jack)
        except jack.JackError:
            self.close()
            found = f"no JACK server {self._server}".rstrip()
            advice = (
                "start one, such as `jackd -R -d alsa -r 48000 -p 128`; "
                "on PipeWire `pw-jack tactophone ...`"
            )
            if is_pipewire():
                found = "PipeWire does not answer"
                advice = "start it (`systemctl --user start pipewire`)"
            raise DeviceError(
                f"{found}: {advice}, or choose portaudio; "
                "no hardware: --source finger, --actuator none"
            ) from None
        self._connect_ports()
        if self._unconnected:
            unconnected = self._unconnected
            self.close()
            raise DeviceError(unconnected)

    def revive(self) -> None:
        """Join again if the server was lost, and connect again what is not connected.

        Another sample rate than at the start is a fault, and the client is silent and
        hears nothing while it lasts: it would render other frequencies, and read
        others. A server may come back with another rate, and PipeWire changes its own
        in the middle of a run, when another program asks for one that it allows.
        """
        if self._left:
            self.close()
        with contextlib.suppress(jack_module().JackError):
            if self._client is None:
                self._join(jack_module())
            if not self._other_rate() and self._connected_at != self._changes.value:
                self._connect_ports()

    def close(self) -> None:
        """Leave the graph, in a thread that goes on if the server does not answer in
        time."""
        client = self._client
        self._client = None
        _OPEN.discard(self)
        if client is None:
            return
        self._losses += self._shutdowns.value > 0
        leaving = threading.Thread(
            target=_leave, args=(client, self._cycle), daemon=True
        )
        _LEAVING.append(leaving)
        leaving.start()
        leaving.join(_LEAVING_LIMIT)

    def ports(self) -> list[JackPort]:
        """Return all ports of the graph but this client's, physical ones first."""
        own = f"{self._client.name}:"
        ports = [
            JackPort(port.name, is_output=port.is_output, physical=port.is_physical)
            for port in self._client.get_ports(is_audio=True)
            if not port.name.startswith(own)
        ]
        return sorted(ports, key=lambda port: not port.physical)

    @property
    def _left(self) -> bool:
        """Whether the server has left the client, which is to be closed."""
        return self._client is not None and self._shutdowns.value > 0

    def _join(self, jack: Any) -> None:
        # libjack would close lost clients while this one joins, in the middle of Python
        # (see the head of this file). So they leave by themselves first.
        for other in list(_OPEN):
            if other._left:
                other.close()
        for leaving in list(_LEAVING):
            leaving.join(_LEAVING_LIMIT)
            if leaving.is_alive():
                raise jack.JackError("a client has not left yet")
            _LEAVING.remove(leaving)
        if not has_socket(self._server) or damage():
            raise jack.JackError("libjack must not be asked now")
        client = jack.Client(
            self._name, servername=self._server or None, no_start_server=True
        )
        for name in self._inputs:
            client.inports.register(name)
        for name in self._outputs:
            client.outports.register(name)
        # Each client has a counter of its own, as a client that is leaving may still
        # count.
        self._shutdowns = _Counter()
        self._xruns.count(client, "jack_set_xrun_callback")
        self._changes.count(client, "jack_set_graph_order_callback")
        # PipeWire 0.3.65 never calls what is registered by jack_on_info_shutdown.
        self._shutdowns.count(client, "jack_on_shutdown")
        self._rate = self._rate or client.samplerate
        self._client = client
        self._cycle = None
        _OPEN.add(self)
        if self._process is not None:
            inputs = PortArrays(client.inports)
            outputs = PortArrays(client.outports)
            self._cycle = _Cycle(
                self, client, self._rate, self._process, inputs, outputs
            )
            client.set_process_callback(self._cycle)
        client.activate()
        # No count of changes is negative: the ports are connected at the next look.
        self._connected_at = -1

    def _other_rate(self) -> str:
        """Return in words that the server runs at another rate than at the start, or an
        empty text."""
        if not self._rate or self.sample_rate in (0, self._rate):
            return ""
        advice = f"start it with that rate (jackd ... -r {self._rate})"
        if is_pipewire():
            advice = (
                f"`pw-metadata -n settings 0 clock.force-rate {self._rate}` sets it"
            )
        found = f"{self._named()} runs at {self.sample_rate} Hz now"
        return f"{found}, but {self._rate} Hz is needed: {advice}"

    def _long_period(self) -> str:
        """Return in words that the periods are too long, or an empty text; any program
        may set their length at any moment."""
        if self.latency <= COMMAND_STALE_AFTER:
            return ""
        advice = "`jack_bufsize 256` sets it"
        if is_pipewire():
            advice = "`pw-metadata -n settings 0 clock.force-quantum 256` sets it"
        return (
            f"{self._named()} has periods of {self.period} samples now, "
            f"{1000 * self.latency:.0f} ms: what vibrates comes late and in pieces, as "
            f"a command holds for {1000 * COMMAND_STALE_AFTER:.0f} ms: {advice}"
        )

    def _connect_ports(self) -> None:
        self._unconnected = ""
        self._connected_at = self._changes.value
        for port in (*self._client.inports, *self._client.outports):
            target = self._targets[port.shortname]
            if target and not port.connections:
                self._connect(port, target)

    def _connect(self, port: Any, target: str) -> None:
        card = self._card_of(target)
        before = self._cards.get(target, card)
        if card != before:
            self._unconnected = (
                f"{target} is {card or 'another port'} now, but {before} is needed: "
                "start the server with that card; to use another, start the run again"
            )
            self._connected_at = -1
            return
        ends = (target, port) if port.is_input else (port, target)
        try:
            self._client.connect(*ends)
            self._cards[target] = card
        except jack_module().JackError:
            candidates = [
                other.name for other in self.ports() if other.is_output == port.is_input
            ]
            self._unconnected = (
                f"{port.name}: there is no JACK port {target} to connect to; there are "
                f"{', '.join(candidates) or 'none'}: choose one in the settings"
            )
            self._connected_at = -1

    def _card_of(self, target: str) -> str:
        """Return the name that jackd's driver gives a port beside ``system:...``, such
        as ``alsa_pcm:hw:USB:in1``: a server that was started with another sound card
        has the same ports.

        Empty for ports without one. PipeWire's ports are named after their card.
        """
        if is_pipewire():
            return ""
        with contextlib.suppress(jack_module().JackError):
            return ", ".join(self._client.get_port_by_name(target).aliases)
        return ""

    def _named(self) -> str:
        if is_pipewire():
            return "PipeWire"
        return f"the JACK server {self._server}".rstrip()


class _Cycle:
    """The callback of one client of a `JackClient`; once ``asked``, it writes silence,
    and its thread ends. While the server runs at another ``rate``, it writes silence
    and passes no sound on.

    The rate is looked at in each period, which costs a call of libjack: what libjack
    calls back for a new rate would have to enter Python (see the head of this file).
    """

    def __init__(
        self,
        owner: JackClient,
        client: Any,
        rate: int,
        process: Process,
        inputs: PortArrays,
        outputs: PortArrays,
    ) -> None:
        self.asked = False
        self.called_at = time.monotonic()
        self._owner = owner
        self._client = client
        self._rate = rate
        self._process = process
        self._inputs = inputs
        self._outputs = outputs
        self._shutdowns = owner._shutdowns
        self._thread = 0

    def __call__(self, size: int) -> None:
        self.called_at = time.monotonic()
        self._thread = self._thread or threading.get_native_id()
        try:
            if not self.asked and self._client.samplerate == self._rate:
                self._process(self._inputs.now(size), self._outputs.now(size))
                return
        except Exception:
            # JACK must not see any exception: it would never call again.
            self._owner.process_faults += 1
        for output in self._outputs.now(size):
            output[:] = 0.0
        if self.asked:
            raise jack_module().CallbackExit

    @property
    def lost(self) -> bool:
        return self._shutdowns.value > 0

    def outside(self) -> bool:
        """Return whether the thread is anywhere but in Python: it has ended or, in a
        lost client, waits for the server (Linux)."""
        if not self._thread:
            return self.lost
        try:
            call = Path(f"/proc/self/task/{self._thread}/syscall").read_text().split()
        except OSError:
            return True  # it has ended
        # The words are the number of the system call and its arguments; a thread that
        # runs has one word, "running". The second argument of a wait holds its flags.
        waits = len(call) > 2
        return self.lost and waits and not int(call[2], 16) & _FUTEX_PRIVATE


def _leave(client: Any, cycle: _Cycle | None) -> None:
    """Close a client once its thread is out of Python; PipeWire cancels no thread."""
    if cycle:
        cycle.asked = True
        quiet_checks = 0
        while not is_pipewire() and quiet_checks < (_QUIET_CHECKS if cycle.lost else 1):
            time.sleep(_CHECK_INTERVAL)
            quiet_checks = quiet_checks + 1 if cycle.outside() else 0
    client.close()


def is_pipewire() -> bool:
    """Return whether PipeWire's libjack is loaded in place of jackd's, as by
    ``pw-jack``."""
    return "PipeWire" in jack_module().version_string()


def disconnect_from_jack(pid: int) -> bool:
    """Disconnect another process from its JACK server, without its help (Linux);
    returns whether that could be done.

    The server repeats the last period of a client that stands still. It cannot be
    disconnected port by port meanwhile: the server would wait for the client to take
    note (measured, jackd 1.9.21). So its *sockets* to the server are shut down, as the
    system does when a process dies: the server removes the client and its ports, silent
    after 6 to 20 ms. A client that goes on later finds its server gone, and joins it
    again (`JackClient.revive`).

    The process must belong to the same user, and be this one or a child of it. If it
    was stopped in the middle of its callback, it may later write the rest of one period
    into memory that belongs to another client by then.
    """
    if sys.platform != "linux":
        return False
    done = False
    with contextlib.suppress(OSError):
        process = os.pidfd_open(pid)
        try:
            for name in os.listdir(f"/proc/{pid}/fd"):
                # The descriptor may be closed meanwhile, or not connected.
                with contextlib.suppress(OSError):
                    done |= _shut_down(process, int(name), f"/proc/{pid}/fd/{name}")
        finally:
            os.close(process)
    return done


def _shut_down(process: int, descriptor: int, link: str) -> bool:
    """Shut down one descriptor of a process, if it is a socket of JACK."""
    if not os.readlink(link).startswith("socket:"):
        return False
    copy = ctypes.CDLL(None).syscall(_PIDFD_GETFD, process, descriptor, 0)
    if copy < 0:
        return False
    with socket.socket(fileno=copy) as shared:
        if shared.family != socket.AF_UNIX or shared.type != socket.SOCK_STREAM:
            return False
        names = (shared.getsockname(), shared.getpeername())
        if not any(_SOCKET_NAME in str(name) for name in names):
            return False
        shared.shutdown(socket.SHUT_RDWR)
    return True
