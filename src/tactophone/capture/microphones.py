"""Microphones as sources: on JACK ports, on a PortAudio device, and of a page in a browser."""

from collections.abc import Mapping, Sequence
from multiprocessing.connection import Connection

from tactophone.capture.live import LiveSource
from tactophone.devices import JackClient, PortAudioStream, StreamDevice
from tactophone.types import LIVE_SAMPLE_RATE

ABSENT = "no page sends sound: open the page on the phone or laptop that listens, and press Use this microphone"


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
    return LiveSource(
        lambda process: JackClient(name, process, inputs=targets, outputs={}, server=server),
        channels=len(targets),
        sample_rate=sample_rate,
    )


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
    return LiveSource(
        lambda process: JackClient(name, process, inputs=targets, outputs={}, server=server),
        channels=len(order),
        order=order,
    )


def portaudio_source(device: str = "", *, channels: int = 2, sample_rate: int = LIVE_SAMPLE_RATE) -> LiveSource:
    """Open the microphones at the first one or two channels of a device, given by number or part of its name."""
    return LiveSource(
        lambda process: PortAudioStream(process, "input", device=device, channels=channels, sample_rate=sample_rate),
        channels=channels,
        sample_rate=sample_rate,
    )


def portaudio_hand_source(fingers: Sequence[tuple[int, int]], device: str = "") -> LiveSource:
    """Open contact and air of each finger at channels of one device, counted from 1; an air channel of 0 is silence."""
    inputs = max(max(pair) for pair in fingers)
    return LiveSource(
        lambda process: PortAudioStream(process, "input", device=device, channels=inputs),
        channels=2 * len(fingers),
        order=[channel - 1 for pair in fingers for channel in pair],
    )


def browser_source(sound: Connection) -> LiveSource:
    """Open the air microphone of the page whose messages ``sound`` delivers (`tactophone.devices.StreamDevice`)."""
    return LiveSource(lambda process: StreamDevice(sound, process, absent=ABSENT), channels=1)
