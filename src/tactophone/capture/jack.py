"""The microphones on JACK ports: two, or two for each finger of a hand."""

from collections.abc import Callable, Mapping

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
    return LiveSource(_client(name, targets, server), channels=len(targets), sample_rate=sample_rate)


def jack_hand_source(
    fingers: Mapping[str, tuple[str, str]], *, server: str = "", name: str = "tactophone-robot"
) -> LiveSource:
    """Open contact and air of each finger, by its name; an empty air port is silence (`jack_source`)."""
    targets, order = dict[str, str](), list[int]()
    for finger, (contact, air) in fingers.items():
        order += [len(targets), len(targets) + 1 if air else -1]
        targets[f"{finger}-contact"] = contact.removeprefix("-")
        if air:
            targets[f"{finger}-air"] = air.removeprefix("-")
    return LiveSource(_client(name, targets, server), channels=len(order), order=order)


def _client(name: str, targets: Mapping[str, str], server: str) -> Callable[[Process], JackClient]:
    def make(process: Process) -> JackClient:
        return JackClient(name, process, inputs=targets, outputs={}, server=server)

    return make
