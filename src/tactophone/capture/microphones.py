"""Microphones as sources: on JACK ports, on a PortAudio device, and of a page in a browser."""

from collections.abc import Mapping, Sequence
from multiprocessing.connection import Connection
from types import MappingProxyType

from tactophone.capture.live import LiveSource
from tactophone.devices.device import StreamDevice
from tactophone.devices.jack import JackClient
from tactophone.devices.portaudio import PortAudioStream
from tactophone.types import LIVE_SAMPLE_RATE, MICROPHONES

ABSENT = "no page sends sound: open the page on the phone or laptop that listens, and press Use this microphone"


def jack_source(
    *, contact: str = "system:capture_1", air: str = "system:capture_2",
    fingers: Mapping[str, tuple[str, str]] = MappingProxyType({}), server: str = "", name: str = "tactophone-robot",
    sample_rate: int = LIVE_SAMPLE_RATE,
) -> LiveSource:  # fmt: skip
    """Open the microphones at the ports of a JACK server.

    Parameters
    ----------
    contact
        Port of the sound card; ``"-"`` leaves it unconnected, for a patch bay.
    air
        Likewise; empty makes a one-channel source.
    fingers
        Of a hand: contact and air of each finger by its name, in place of the two above; an empty air port is silence.
    server
        The JACK server's name; empty for the default one.
    """
    targets, order = dict[str, str](), list[int]()
    for finger, ports in fingers.items() or [("", (contact, air))]:
        for port, kind in zip(ports, MICROPHONES, strict=True):
            order.append(len(targets) if port or kind == "contact" else -1)
            if order[-1] >= 0:
                targets[f"{finger}-{kind}".removeprefix("-")] = port.removeprefix("-")
    if not fingers:
        order = order[: len(targets)]
    return LiveSource(
        lambda process: JackClient(name, process, inputs=targets, outputs={}, server=server),
        channels=len(order),
        sample_rate=sample_rate,
        order=order,
    )


def portaudio_source(
    device: str = "", *, channels: int = 2, fingers: Sequence[tuple[int, int]] = (), sample_rate: int = LIVE_SAMPLE_RATE
) -> LiveSource:
    """Open the microphones on a PortAudio device.

    Parameters
    ----------
    device
        Its number or part of its name; empty for the system's default.
    channels
        How many of its first channels: 1 (contact) or 2 (contact, air).
    fingers
        Of a hand: contact and air channel of each finger, counted from 1, in place of the first two; an air channel of
        0 is silence.
    """
    order = [channel - 1 for pair in fingers for channel in pair] or list(range(channels))
    return LiveSource(
        lambda process: PortAudioStream(
            process, "input", device=device, channels=max(order) + 1, sample_rate=sample_rate
        ),
        channels=len(order),
        sample_rate=sample_rate,
        order=order,
    )


def browser_source(sound: Connection) -> LiveSource:
    """Open the air microphone of the page whose messages ``sound`` delivers (a `StreamDevice`)."""
    return LiveSource(lambda process: StreamDevice(sound, process, absent=ABSENT), channels=1)
