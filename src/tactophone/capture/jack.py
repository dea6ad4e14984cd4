"""The two microphones on JACK ports."""

from tactophone.capture.live import LiveSource
from tactophone.devices import JackClient
from tactophone.devices.device import Process


def jack_source(
    *,
    contact: str = "system:capture_1",
    air: str = "system:capture_2",
    server: str = "",
    name: str = "tactophone-robot",
    sample_rate: int = 48_000,
) -> LiveSource:
    """Listen at two JACK ports, or at one.

    Parameters
    ----------
    contact, air
        Ports that give the sound. An empty ``air`` makes a one-channel source; ``"-"`` leaves a port unwired, for
        a patch bay to wire.
    server
        The JACK server's name; empty for the default one.
    """
    wires = {"contact": contact.removeprefix("-")}
    if air:
        wires["air"] = air.removeprefix("-")

    def make(process: Process) -> JackClient:
        return JackClient(name, process, inputs=wires, outputs={}, server=server)

    return LiveSource(make, channels=len(wires), sample_rate=sample_rate)
