"""Live microphones as sources: on JACK ports, a PortAudio device or a page; with losses
and overflows counted.

The device's own thread copies a period into a queue and returns; the iterator takes it
out. When the queue holds more than `LONGEST_WAIT`, new sound is dropped and counted, as
it would be stale by the time it is rendered.
"""

import queue
from collections.abc import Callable, Iterator, Mapping, Sequence
from multiprocessing.connection import Connection
from types import MappingProxyType
from typing import Self

import numpy as np

from tactophone.core.errors import ConfigError
from tactophone.core.hand import each_finger, names_of
from tactophone.core.microphones import MICROPHONES
from tactophone.core.settings import Settings
from tactophone.core.types import (
    LIVE_SAMPLE_RATE,
    AudioBlock,
    FloatArray,
    Source,
    joined,
)
from tactophone.live.audio.device import (
    Device,
    Process,
    StreamDevice,
    open_at_live_rate,
)
from tactophone.live.audio.jack import JackClient
from tactophone.live.audio.portaudio import PortAudioStream

LONGEST_WAIT = 0.06
"""Seconds of sound that may be queued: older sound is stale on arrival
(`link.stream.SOUND_STALE_AFTER`)."""

REVIVE_INTERVAL = 0.25
"""Seconds without sound between two attempts to reconnect the device."""

ABSENT = (
    "no page sends sound: open the page on the phone or laptop that listens, "
    "and press Use this microphone"
)
"""Fault of a page's microphone while no sound arrives."""


def _any() -> int:
    """Return how many samples a reader needs that takes any number."""
    return 1


class LiveSource:
    """A sound device at the live rate as a `tactophone.core.types.Source`.

    - ``open_device``: makes the device, given the process that takes its sound.
    - ``channels``: 1 (contact) or 2 (contact, air); for a hand, two for each finger.
    - ``order``: for each channel the input of the device, counted from 0; -1 is
      silence. By default all inputs in their order.
    - ``overflows``: periods dropped because too many waited.
    - ``period``: samples of the newest period; 0 before the first.
    """

    sample_rate = LIVE_SAMPLE_RATE

    def __init__(
        self,
        open_device: Callable[[Process], Device],
        *,
        channels: int,
        order: Sequence[int] = (),
    ) -> None:
        self.overflows = 0
        self.period = 0
        self._queue: queue.SimpleQueue[list[AudioBlock] | None] = queue.SimpleQueue()
        # Samples are counted by two threads, and each number is written by one alone:
        # the device's thread counts what it queued, the reader's what it took.
        self._queued = 0
        self._taken = 0
        self._position = 0
        """Samples that the device has delivered, dropped ones included."""
        self._held: list[AudioBlock] = []
        """Blocks for which the reader is not woken yet."""
        self._idle = False
        """Whether the reader waits."""
        self._needed = _any
        self.channels = channels
        self._open = False
        self._order = [
            (channel, place)
            for channel, place in enumerate(order or range(channels))
            if place >= 0
        ]
        self.device = open_device(self._enqueue)

    def __enter__(self) -> Self:
        open_at_live_rate(self.device)
        self._open = True
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def close(self) -> None:
        """End the sound, also from another thread: the iteration then ends."""
        self._open = False
        self._queue.put(None)
        self.device.close()

    def __iter__(self) -> Iterator[AudioBlock]:
        for blocks in self._arrivals():
            yield from blocks

    def joined(self, needed: Callable[[], int] = _any) -> Iterator[AudioBlock]:
        """Iterate, with all blocks that wait joined into one: a reader that was late
        catches up at once.

        ``needed`` returns how many samples the reader needs to have anything to do: it
        is not woken for fewer. It is called in the device's thread, and only while the
        reader waits.
        """
        self._needed = needed
        for arrived in self._arrivals():
            blocks = arrived
            while not self._queue.empty():
                following = self._queue.get()
                if following is None:
                    # The end goes back into the queue: the iteration is to see it after
                    # this sound.
                    self._queue.put(None)
                    break
                blocks = [*blocks, *self._take(following)]
            yield from joined(blocks)

    def _arrivals(self) -> Iterator[list[AudioBlock]]:
        while self._open:
            self._idle = True
            try:
                blocks = self._queue.get(timeout=REVIVE_INTERVAL)
            except queue.Empty:
                self.device.revive()
                continue
            self._idle = False
            if blocks is None:
                return
            yield self._take(blocks)

    def _take(self, blocks: list[AudioBlock]) -> list[AudioBlock]:
        self._taken += sum(block.size for block in blocks)
        return blocks

    def _enqueue(self, inputs: list[FloatArray], _: list[FloatArray]) -> None:
        # The position advances for dropped sound too, so that ``start`` jumps by what
        # was lost.
        start = self._position
        self.period = len(inputs[0])
        self._position = start + self.period
        if self._queued - self._taken > LONGEST_WAIT * self.sample_rate:
            self.overflows += 1
            return
        samples = np.zeros((self.period, self.channels), np.float32)
        for channel, place in self._order:
            samples[:, channel] = inputs[place]
        self._queued += self.period
        self._held.append(
            AudioBlock(samples, sample_rate=self.sample_rate, start=start)
        )
        held = self._position - self._held[0].start
        if not self._idle or held >= self._needed():
            self._queue.put(self._held)
            self._held = []


def jack_source(
    *,
    contact: str = "system:capture_1",
    air: str = "system:capture_2",
    fingers: Mapping[str, tuple[str, str]] = MappingProxyType({}),
    server: str = "",
    name: str = "tactophone-robot",
) -> LiveSource:
    """Open the microphones at the ports of a JACK server.

    Parameters
    ----------
    contact
        Port of the sound card; ``"-"`` leaves it unconnected, for a patch bay.
    air
        Likewise; empty makes a one-channel source.
    fingers
        For a hand: contact and air of each finger by its name, in place of the two
        above; an empty air port is silence.
    server
        The JACK server's name; empty for the default one.
    name
        Of our client, as a patch bay shows it.
    """
    # The client's own ports, each with the port that it is connected to.
    targets = dict[str, str]()
    order = list[int]()
    for finger, ports in fingers.items() or [("", (contact, air))]:
        for port, kind in zip(ports, MICROPHONES, strict=True):
            if not port and kind == "air":
                order.append(-1)
                continue
            order.append(len(targets))
            targets[f"{finger}-{kind}".removeprefix("-")] = port.removeprefix("-")
    if not fingers:
        # A single finger without an air microphone has one channel, not a silent one.
        order = order[: len(targets)]
    return LiveSource(
        lambda process: JackClient(
            name, process, inputs=targets, outputs={}, server=server
        ),
        channels=len(order),
        order=order,
    )


def portaudio_source(
    device: str = "", *, channels: int = 2, fingers: Sequence[tuple[int, int]] = ()
) -> LiveSource:
    """Open the microphones on a PortAudio device.

    Parameters
    ----------
    device
        Its number or part of its name; empty for the system's default.
    channels
        How many of its first channels: 1 (contact) or 2 (contact, air).
    fingers
        For a hand: contact and air channel of each finger, counted from 1, in place of
        the first two; an air channel of 0 is silence.
    """
    order = [channel - 1 for pair in fingers for channel in pair]
    if not fingers:
        order = list(range(channels))
    return LiveSource(
        lambda process: PortAudioStream(
            process, "input", device=device, channels=max(order) + 1
        ),
        channels=len(order),
        order=order,
    )


def browser_source(sound: Connection) -> LiveSource:
    """Open the air microphone of the page whose messages ``sound`` delivers (a
    `StreamDevice`)."""
    return LiveSource(
        lambda process: StreamDevice(sound, process, absent=ABSENT), channels=1
    )


def open_device(settings: Settings) -> Source:
    """Open the microphones; `tactophone.app.sources` opens recordings and the simulated
    finger too.

    The microphones of a hand are at one JACK server, or on one PortAudio device.
    """
    capture = settings.capture
    process = settings.process
    hand = dict[str, tuple[str, str]]()
    if settings.is_hand:
        pairs = [
            (own.capture.contact, own.capture.air) for own in each_finger(settings)
        ]
        hand = dict(zip(names_of(settings), pairs, strict=True))
    match capture.source:
        case "jack":
            name = process.name or "tactophone-robot"
            return jack_source(
                contact=capture.contact,
                air=capture.air,
                fingers=hand,
                server=process.jack_server,
                name=name,
            )
        case "portaudio":
            channels = [
                (_channel(contact), _channel(air) if air else 0)
                for contact, air in hand.values()
            ]
            return portaudio_source(
                capture.device, channels=2 if capture.air else 1, fingers=channels
            )
        case "microphone" if not hand:
            return portaudio_source(capture.device, channels=1)
    if hand:
        raise ConfigError(
            f"capture.source = {capture.source!r} has one finger: "
            "a hand's microphones are at jack or portaudio"
        )
    raise ConfigError(
        f"capture.source = {capture.source!r} is not a device; "
        "devices are jack, portaudio and microphone"
    )


def _channel(text: str) -> int:
    """Return the number of a device's channel; the default, a JACK port, stands for the
    channel of its number."""
    number = text.removeprefix("system:capture_")
    if not number.isdecimal() or not int(number):
        raise ConfigError(
            f"{text!r} is no channel of a PortAudio device: "
            "write its number, as in contact = 3"
        )
    return int(number)
