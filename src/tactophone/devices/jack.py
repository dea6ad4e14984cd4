"""JACK clients that outlive their server.

What JACK does when things fail was measured (docs/hardware.md) and shapes this file. A process callback that
raises is never called again, without a word: so nothing may leave it. A server that ends calls back once and leaves
a client behind that answers with stale values: so that client is thrown away and a new one made when the server is
back. A client that *stalls* has its last period repeated for ever: only another process can help against that, see
:mod:`tactophone.runtime.watchdog`.
"""

import contextlib
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from tactophone.devices.device import Process
from tactophone.errors import DeviceError
from tactophone.types import FloatArray

_ABANDONED: list[Any] = []
"""Clients of servers that died: kept, because libjack's threads may still call back into one."""


@dataclass(frozen=True, slots=True)
class JackPort:
    """One port of a JACK graph: where sound comes out of (``gives``) or goes into."""

    name: str
    gives: bool
    physical: bool


class JackClient:
    """A JACK client with named ports, each wired to another's port or left free.

    Parameters
    ----------
    name
        As the JACK graph shows it.
    process
        Called each period; see `tactophone.devices.device.Process`.
    inputs, outputs
        Own ports' names, each with the port to wire it to; an empty text leaves it free.
    server
        The JACK server's name; empty for the default one.
    """

    def __init__(
        self, name: str, process: Process, *, inputs: Mapping[str, str], outputs: Mapping[str, str], server: str = ""
    ) -> None:
        self.xruns = self.process_faults = self.losses = 0
        self._name, self._process, self._server = name, process, server
        self._wires = {**inputs, **outputs}
        self._inputs, self._outputs = list(inputs), list(outputs)
        self._client: Any = None
        self._lost = False
        self._unwired = ""
        self._rewire = True

    @property
    def sample_rate(self) -> int:
        """In Hz; 0 while there is no server."""
        return int(self._client.samplerate) if self._client else 0

    @property
    def period(self) -> int:
        """Samples a period; 0 while there is no server."""
        return int(self._client.blocksize) if self._client else 0

    @property
    def latency(self) -> float:
        """Seconds of one period and of what the wired ports say of the hardware behind them."""
        return self.period / self.sample_rate if self.sample_rate else 0.0

    @property
    def fault(self) -> str:
        """What is wrong now, in words."""
        if self._lost or self._client is None:
            return f"the JACK server{self._named()} is gone: start it again, and sound comes back by itself"
        return self._unwired

    def open(self) -> None:
        """Join the graph and wire the ports.

        Raises
        ------
        DeviceError
            When there is no server, or a port to wire to is not there.
        """
        jack = _jack()
        try:
            self._join(jack)
        except jack.JackError:
            self.close()
            raise DeviceError(
                f"no JACK server{self._named()}: start one, such as `jackd -R -d alsa -r 48000 -p 128`, "
                "or choose portaudio"
            ) from None
        self._wire()
        if self._unwired:
            unwired = self._unwired
            self.close()
            raise DeviceError(unwired)

    def revive(self) -> None:
        """Join again if the server was lost, and wire again what is not wired."""
        if self._lost:
            self._abandon()
        with contextlib.suppress(_jack().JackError):
            if self._client is None:
                self._join(_jack())
            if self._rewire:
                self._wire()

    def close(self) -> None:
        """Leave the graph."""
        if self._lost:
            self._abandon()
        client, self._client = self._client, None
        if client is not None:
            with contextlib.suppress(_jack().JackError):
                client.close()

    def ports(self) -> list[JackPort]:
        """All ports of the graph but our own, physical ones first."""
        own = f"{self._client.name}:"
        ports = [
            JackPort(port.name, gives=port.is_output, physical=port.is_physical)
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
        client.set_process_callback(self._cycle(list(client.inports), list(client.outports)))
        client.set_xrun_callback(self._on_xrun)
        client.set_shutdown_callback(self._on_shutdown)
        # Asking a port for its wires again and again would do too, but crashes when the server dies meanwhile.
        client.set_port_connect_callback(self._on_wire)
        self._client, self._rewire = client, True
        client.activate()

    def _abandon(self) -> None:
        """Forget the client of a dead server: closing it crashes once a new server has taken over its memory."""
        self._client._ptr = _jack()._ffi.NULL  # else the binding closes it when it is collected, at exit at the latest
        _ABANDONED.append(self._client)
        self._client, self._lost = None, False

    def _cycle(self, inputs: list[Any], outputs: list[Any]) -> Callable[[int], None]:
        def cycle(_: int) -> None:
            try:
                self._process([port.get_array() for port in inputs], [port.get_array() for port in outputs])
            except Exception:  # whatever it was, JACK must not see it: it would never call again
                self.process_faults += 1
                for port in outputs:
                    port.get_array()[:] = 0.0

        return cycle

    def _wire(self) -> None:
        self._unwired, self._rewire = "", False
        for port in (*self._client.inports, *self._client.outports):
            target = self._wires[port.shortname]
            if target and not port.connections:
                self._connect(port, target)

    def _connect(self, port: Any, target: str) -> None:
        ends = (target, port) if port.is_input else (port, target)
        try:
            self._client.connect(*ends)
        except _jack().JackError:
            candidates = [other.name for other in self.ports() if other.gives == port.is_input]
            self._unwired = (
                f"{port.name}: there is no JACK port {target} to wire it to; there are "
                f"{', '.join(candidates) or 'none'}: choose one of them in the settings"
            )
            self._rewire = True

    def _on_xrun(self, _: float) -> None:
        self.xruns += 1

    def _on_wire(self, _one: Any, _other: Any, connected: bool) -> None:
        self._rewire |= not connected

    def _on_shutdown(self, _status: Any, _reason: str) -> None:
        self._lost = True
        self.losses += 1

    def _named(self) -> str:
        return f" {self._server}" if self._server else ""


def _jack() -> Any:
    """Import JACK's binding, which needs an extra and the system's library, and quiet the library's own messages."""
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


def _ignore(_: str) -> None:
    """Take a message of libjack: what matters in it comes as an exception too."""


def silent(_: list[FloatArray], outputs: list[FloatArray]) -> None:
    """Take part in the graph without a sound: a process for who only wants to look."""
    for output in outputs:
        output[:] = 0.0
