"""The two microphones on JACK ports."""

from tactophone.capture.live import LiveSource
from tactophone.devices import JackClient, Process
from tactophone.types import LIVE_SAMPLE_RATE


def jack_source(
    *,
    contact: str = "system:capture_1",
    air: str = "system:capture_2",
    server: str = "",
    name: str = "tactophone-robot",
    sample_rate: int = LIVE_SAMPLE_RATE,
) -> LiveSource:
    """Open the microphones at two JACK ports, or at one.

    Parameters
    ----------
    contact, air
        Ports of the sound card. An empty ``air`` makes a one-channel source; ``"-"`` leaves a port unconnected, for a
        patch bay.
    server
        The JACK server's name; empty for the default one.
    """
    targets = {"contact": contact.removeprefix("-")}
    if air:
        targets["air"] = air.removeprefix("-")

    def make(process: Process) -> JackClient:
        return JackClient(name, process, inputs=targets, outputs={}, server=server)

    return LiveSource(make, channels=len(targets), sample_rate=sample_rate)
