"""Latency of the running system from an impulse at the microphones to the first
vibration, stage by stage.

A client of the same JACK graph plays impulses into the robot's ports (or into a
loudspeaker in front of its microphones) and records the operator's port (or a sensor on
the actuator). The check of the microphones is on, as in use: every port of the robot
carries background noise, and an impulse sounds different at contact and air.

Two independent measurements with different clocks must agree: *end to end*, by counting
samples of one sound clock, and *the budget*, by the marks that both sides record on the
system clock for the packet that caused the vibration.
"""

import secrets
import time
from collections.abc import Callable, Iterable, Iterator
from contextlib import closing, contextmanager
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tactophone.core.errors import TactophoneError
from tactophone.core.hand import names_of
from tactophone.core.microphones import AIR, CONTACT, MICROPHONES
from tactophone.core.settings import FingerSettings, Settings, change
from tactophone.core.types import LIVE_SAMPLE_RATE, FloatArray, ignore
from tactophone.live.audio.jack import JackClient
from tactophone.live.audio.sources import open_device
from tactophone.live.runtime.pairing import Sides, both_sides
from tactophone.live.runtime.wiring import OpenSource
from tactophone.live.telemetry.layout import MARKS, STAGES
from tactophone.live.telemetry.watcher import Watcher
from tactophone_lab.measurement.port_sounds import Background

PROBE_BURST = 0.03
"""Seconds of an impulse: the shortest burst that is felt as vibration (Sci. Rep. 2025,
15:5057)."""

TONE = 300.0
"""Hz of an impulse: near the best sensitivity of the skin, and within every codec's
band."""

PEAK = 0.8
"""Amplitude of an impulse at the contact microphone; its first sample is the
highest."""

AIR_TONE = 900.0
"""Hz of an impulse at the air microphone, which hears the brighter part of a touch."""

AIR_PEAK = 0.1
"""Amplitude of an impulse at the air microphone."""

INTERVALS = (0.33, 0.38)
"""Range of seconds between impulses, uniform: the vibration has faded before, as it
ends 279 ms after an impulse at the latest and 20 ms later over a slow link, and every
phase of the period occurs."""

FIRST_ARRIVAL = 1e-4
"""Amplitude above which a sample vibrates, 80 dB below full drive; at rest, every
sample is exactly zero."""

LONGEST = 0.15
"""Seconds after which an impulse counts as missed."""

IMPULSE_WARM_UP = 1.5
"""Seconds of sound before the first impulse, in which estimators converge."""

AT_REST = 480
"""Samples before an impulse, 10 ms, in which nothing may vibrate: what vibrates later
would be taken for its own vibration."""

COLLECT_EVERY = 0.2
"""Seconds between two reads of the marks, which telemetry keeps for ten seconds, and
two looks whether the player is still connected to both sides."""


@dataclass(frozen=True, slots=True, eq=False)
class ImpulseLatency:
    """The measured latencies, one entry for each impulse, in seconds."""

    impulses: int
    """Number played. Some are missed and some cannot be judged; these are in no
    array."""
    end_to_end: NDArray[np.float64]
    """By counted samples."""
    stages: dict[str, NDArray[np.float64]]
    """By marks, for each stage of `tactophone.live.telemetry.layout.STAGES`; only
    impulses with all marks."""
    disagreement: float
    """Difference between the mean end-to-end latency of those impulses and the mean sum
    of their stages."""
    period: int
    """Samples of a period of the JACK server."""
    missed_at: tuple[float, ...] = ()
    """When each missed impulse was played, in seconds from the first sample on."""
    late_to_rest_at: tuple[float, ...] = ()
    """The same for those that came while the vibration before had not ended, which are
    not judged."""
    restarts: int = 0
    """Number of times that a side was restarted; later impulses are missed, as it stays
    muted."""
    device_losses: int = 0
    """Times that a side lost the sound server, which disconnects it where it is late;
    impulses are missed until the player has connected to it again."""
    xruns: int = 0
    """Periods that the sound server lost."""

    @property
    def missed(self) -> int:
        return len(self.missed_at)

    @property
    def late_to_rest(self) -> int:
        return len(self.late_to_rest_at)

    @property
    def incidents(self) -> str:
        """What went wrong while it was measured, in words; each miss with its time."""
        at = {"missed": self.missed_at, "late to rest": self.late_to_rest_at}
        words = [
            f"{len(times)} {name} (at {', '.join(f'{time:.2f}' for time in times)} s)"
            if times
            else f"0 {name}"
            for name, times in at.items()
        ]
        counted = {
            "device losses": self.device_losses,
            "xruns": self.xruns,
            "restarts": self.restarts,
        }
        words += [f"{count} {name}" for name, count in counted.items() if count]
        return ", ".join(words)


class ImpulsePlayer:
    """Plays impulses and records the vibration; ``process`` is for a JACK client and
    allocates nothing.

    Of its outputs, the first is for a contact microphone, the second for an air
    microphone, and so on. With ``background``, all of them carry the noise of a
    microphone too.

    ``played``: the impulses at contact and air, ``(2, samples)``; ``vibration``: what
    came back.
    """

    def __init__(
        self, impulses: int, *, seed: int = 0, background: bool = False
    ) -> None:
        gaps = (
            np.random.default_rng([0xC11C, seed]).uniform(*INTERVALS, impulses)
            * LIVE_SAMPLE_RATE
        )
        self.impulses: NDArray[np.int64] = (
            IMPULSE_WARM_UP * LIVE_SAMPLE_RATE + np.cumsum(gaps)
        ).astype(np.int64)
        size = int(self.impulses[-1] + INTERVALS[1] * LIVE_SAMPLE_RATE)
        self.played = np.zeros((len(MICROPHONES), size), np.float32)
        self.vibration = np.zeros(size, np.float32)
        times = np.arange(int(PROBE_BURST * LIVE_SAMPLE_RATE)) / LIVE_SAMPLE_RATE
        for row, peak, tone in (
            (self.played[CONTACT], PEAK, TONE),
            (self.played[AIR], AIR_PEAK, AIR_TONE),
        ):
            burst = peak * np.cos(2 * np.pi * tone * times)
            for impulse in self.impulses:
                row[impulse : impulse + len(burst)] = burst
        self._background = Background() if background else None
        self.position = 0
        self._cycles = np.full((size // 16, 2), np.nan)
        self._count = 0

    @property
    def done(self) -> bool:
        """Whether all impulses were played and the time for their vibration has
        passed."""
        return self.position >= len(self.vibration)

    @property
    def cycles(self) -> NDArray[np.float64]:
        """The start of each period: its first sample, and the system clock in s; shape
        ``(periods, 2)``."""
        return self._cycles[: self._count]

    def process(self, inputs: list[FloatArray], outputs: list[FloatArray]) -> None:
        size = len(outputs[0])
        position = self.position
        if position + size > len(self.vibration) or self._count >= len(self._cycles):
            self.position = len(self.vibration)
            for output in outputs:
                output[:] = 0.0
            return
        self._cycles[self._count] = position, time.monotonic()
        self._count += 1
        for port, output in enumerate(outputs):
            microphone = port % len(MICROPHONES)
            output[:] = self.played[microphone, position : position + size]
            if self._background:
                self._background.add(output, port, position)
        self.vibration[position : position + size] = inputs[0]
        self.position = position + size

    def onsets(self) -> Iterator[tuple[int, int]]:
        """Yield each impulse that caused vibration, and the first sample that vibrates
        after it."""
        for impulse in self.impulses:
            first = self._first_vibration(impulse)
            if first is not None and self._rests_before(impulse):
                yield int(impulse), first

    def missed(self) -> Iterator[int]:
        """Yield each impulse that caused no vibration."""
        for impulse in self.impulses:
            if self._rests_before(impulse) and self._first_vibration(impulse) is None:
                yield int(impulse)

    def late_to_rest(self) -> Iterator[int]:
        """Yield each impulse that came while the vibration before had not ended."""
        for impulse in self.impulses:
            if not self._rests_before(impulse):
                yield int(impulse)

    def _first_vibration(self, impulse: int) -> int | None:
        after = self.vibration[impulse : impulse + int(LONGEST * LIVE_SAMPLE_RATE)]
        found = np.flatnonzero(np.abs(after) > FIRST_ARRIVAL)
        return int(impulse + found[0]) if len(found) else None

    def _rests_before(self, impulse: int) -> bool:
        before = self.vibration[impulse - AT_REST : impulse]
        return bool(np.abs(before).max() <= FIRST_ARRIVAL)

    def clock(self, sample: int) -> float:
        """Return the system clock (s) at a sample, counted from the start of its
        period."""
        start, begun = self.cycles[
            np.searchsorted(self.cycles[:, 0], sample, side="right") - 1
        ]
        return float(begun + (sample - start) / LIVE_SAMPLE_RATE)


def analyse(
    player: ImpulsePlayer, marks: dict[str, NDArray[np.void]], *, period: int
) -> ImpulseLatency:
    """Follow the packet of each impulse through the marks."""
    onsets = list(player.onsets())
    found = [_moments(player, marks, impulse, onset) for impulse, onset in onsets]
    complete = [pair for pair, moments in zip(onsets, found, strict=True) if moments]
    followed = np.array(
        [(onset - impulse) / LIVE_SAMPLE_RATE for impulse, onset in complete]
    )
    # Rows are impulses; the differences of nine successive moments are the durations of
    # the eight stages.
    table = np.diff(
        np.array([moments for moments in found if moments]).reshape(
            -1, len(STAGES) + 1
        ),
        axis=1,
    )
    return ImpulseLatency(
        impulses=len(player.impulses),
        end_to_end=np.array(
            [(onset - impulse) / LIVE_SAMPLE_RATE for impulse, onset in onsets]
        ),
        stages={stage: table[:, index] for index, stage in enumerate(STAGES)},
        disagreement=float(abs(table.sum(axis=1).mean() - followed.mean()))
        if len(followed)
        else float("nan"),
        period=period,
        missed_at=_seconds(player.missed()),
        late_to_rest_at=_seconds(player.late_to_rest()),
    )


def _seconds(samples: Iterable[int]) -> tuple[float, ...]:
    return tuple(sample / LIVE_SAMPLE_RATE for sample in samples)


def _moments(
    player: ImpulsePlayer, marks: dict[str, NDArray[np.void]], impulse: int, onset: int
) -> list[float] | None:
    """Return the nine moments that bound the eight stages; ``None`` when a mark is
    missing."""
    period_start = player.cycles[
        np.searchsorted(player.cycles[:, 0], impulse, side="right") - 1, 1
    ]
    captured = int(np.searchsorted(marks["captured"]["time"], period_start))
    # The operator's callback of the same period ran before the player's, so its mark is
    # the last one before it.
    played = player.cycles[
        np.searchsorted(player.cycles[:, 0], onset, side="right") - 1, 1
    ]
    rendered = int(np.searchsorted(marks["rendered"]["time"], played)) - 1
    if captured == len(marks["captured"]) or rendered < 0:
        return None
    end = int(marks["rendered"]["position"][rendered])
    times = [
        _time_at(marks[name], end)
        for name in ("sent", "received", "released", "decoded", "detected")
    ]
    found = [moment for moment in times if moment is not None]
    if len(found) < len(times):
        return None
    first, last = (
        float(marks[name]["time"][row])
        for name, row in (("captured", captured), ("rendered", rendered))
    )
    return [player.clock(impulse), first, *found, last, player.clock(onset)]


def _time_at(marks: NDArray[np.void], end: int) -> float | None:
    """Return the time of the first mark at an RTP timestamp or less than half a second
    after it."""
    beyond = (marks["position"] - end) % (1 << 32)
    found = np.flatnonzero(beyond < LIVE_SAMPLE_RATE // 2)
    return float(marks["time"][found[0]]) if len(found) else None


@dataclass(frozen=True, slots=True)
class Graph:
    """The JACK ports of impulses and vibration; empty names mean the sides' own
    ports."""

    server: str = ""
    impulse_port: str = ""
    vibration_port: str = ""


def measure(
    settings: Settings,
    graph: Graph,
    *,
    impulses: int = 100,
    seed: int = 0,
    progress: Callable[[float], None] = ignore,
) -> ImpulseLatency:
    """Run both sides on this machine, play impulses, and measure.

    Raises `TactophoneError` when a side does not start, or the two do not connect.
    """
    with running_sides(settings, graph) as (operator, robot):
        # A loudspeaker's room has noise of its own.
        player = ImpulsePlayer(impulses, seed=seed, background=not graph.impulse_port)
        outputs = {port: f"{robot.name}:{port}" for port in microphone_ports(settings)}
        if graph.impulse_port:
            outputs = {"impulse": graph.impulse_port}
        # A hand is timed at its last finger, whose step is computed after all others.
        last = names_of(settings)[-1] or "vibration"
        inputs = {"vibration": graph.vibration_port or f"{operator.name}:{last}"}
        client = JackClient(
            "tactophone-player",
            player.process,
            inputs=inputs,
            outputs=outputs,
            server=graph.server,
        )
        watchers = Watcher(robot.name), Watcher(operator.name)
        before = _incidents(watchers)
        with closing(client):
            client.open()
            marks = _collect(player, client, *watchers, progress)
            period = client.period
        losses, xruns = np.subtract(_incidents(watchers), before).tolist()
        restarts = robot.restarts + operator.restarts
    return replace(
        analyse(player, marks, period=period),
        restarts=restarts,
        device_losses=losses,
        xruns=xruns,
    )


def microphone_ports(settings: Settings) -> list[str]:
    """Return the names of the robot's ports: contact and air of each finger in turn."""
    return [
        f"{finger}-{end}".lstrip("-")
        for finger in names_of(settings)
        for end in MICROPHONES
    ]


def _incidents(watchers: Iterable[Watcher]) -> tuple[int, int]:
    """Return how often a side has lost the sound server, and the periods that this has
    lost, as both sides see it."""
    counters = [watcher.totals()[0] for watcher in watchers]
    return (
        sum(counter["device_losses"] for counter in counters),
        max(counter["xruns"] for counter in counters),
    )


def _collect(
    player: ImpulsePlayer,
    client: JackClient,
    robot: Watcher,
    operator: Watcher,
    progress: Callable[[float], None],
) -> dict[str, NDArray[np.void]]:
    """Wait until the player is done, and collect the marks before they are overwritten.

    A side that was late and lost the server joins it again, with new ports.
    """
    kept: dict[str, list[NDArray[np.void]]] = {name: [] for name in MARKS}
    while not player.done:
        time.sleep(COLLECT_EVERY)
        client.revive()
        progress(player.position / len(player.vibration))
        for name, found in kept.items():
            found.append(
                (robot if name in ("captured", "sent") else operator).marks(name)
            )
    # Unique: two reads may return the same marks, and two packets at one moment differ.
    whole = {name: np.unique(np.concatenate(found)) for name, found in kept.items()}
    return {
        name: found[np.argsort(found["time"], kind="stable")]
        for name, found in whole.items()
    }


@contextmanager
def running_sides(
    settings: Settings, graph: Graph, *, open_source: OpenSource = open_device
) -> Iterator[Sides]:
    """Run operator and robot, and yield both once they are connected; the robot
    captures ``open_source``.

    Of ports that nothing plays to, the check of the microphones says that they are
    dead: switch it off for those.
    """
    changes = ["capture.source=jack", "output.actuator=jack"]
    if graph.server:
        changes.append(f"process.jack_server={graph.server}")
    if graph.impulse_port:
        # The path leads over hardware outside the graph, and one loudspeaker may sound
        # alike at both microphones.
        changes.append("detector.check_microphones=false")
    else:
        free = dict.fromkeys(("capture.contact", "capture.air", "output.port"), "-")
        changes += [f"{name}={port}" for name, port in free.items()]
        fingers = (
            FingerSettings(each.name, tuple((dict(each.settings) | free).items()))
            for each in settings.fingers
        )
        settings = replace(settings, fingers=tuple(fingers))
    settings = change(settings, changes)
    name = f"{settings.process.name or 'latency'}-{secrets.token_hex(3)}"
    with both_sides(settings, name=name, open_source=open_source) as sides:
        watcher = Watcher(sides.operator.name)
        for _ in range(500):
            if watcher.snapshot().counters["packets_received"] > 10:
                break
            time.sleep(0.02)
        else:
            raise TactophoneError(
                "robot and operator did not connect within 10 s: run `tactophone "
                "loopback` to see why"
            )
        yield sides
