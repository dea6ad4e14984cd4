"""ROS 2 over DDS or Zenoh: predictions, vibration, sound and diagnostics out; stop and mute in.

Neither has authentication by default. So the two inbound topics can end a vibration, and no topic can begin one.
"""

import time
from collections.abc import Sequence
from typing import Self

import numpy as np

from tactophone.bridges.reader import Newest, NewestReader
from tactophone.bridges.ros import messages
from tactophone.bridges.ros.dds import DdsTransport, Transport, default_domain
from tactophone.bridges.ros.sinks import open_sinks
from tactophone.telemetry import Snapshot
from tactophone.types import LIVE_SAMPLE_RATE

INTERVAL = 0.01
"""Seconds between two reads."""

DIAGNOSTICS_INTERVAL = 1.0
"""Seconds between two diagnostics, as ROS's aggregator expects them."""


class RosBridge:
    """Passes a run on to ROS 2; a context manager whose `read` is called every `INTERVAL`.

    Parameters
    ----------
    name
        Of a run that exists already.
    finger
        Part of the topics; those of a hand have names.
    publish
        Whether to publish predictions, sound and diagnostics; otherwise only the sinks get something.
    sinks
        Devices to drive, as `open_sink` takes them.
    domain
        Of ROS; ``None`` takes ROS_DOMAIN_ID.
    over
        ``dds`` or ``zenoh``.

    Raises
    ------
    ConfigError
        If the domain cannot be joined.
    """

    interval = INTERVAL

    def __init__(
        self, name: str, *, finger: str = "index", publish: bool = True, sinks: Sequence[str] = (),
        domain: int | None = None, over: str = "dds",
    ) -> None:  # fmt: skip
        self._name, self._publishes = name, publish
        self._domain, self._over = default_domain() if domain is None else domain, over
        self._reader = NewestReader(name, finger=finger)
        self._sinks = [sink for text in sinks for sink in open_sinks(text, fingers=self._reader.fingers)]
        self._snapshots: dict[str, Snapshot] = {}
        self._beat = 0
        self._amplitudes = dict.fromkeys(self._reader.fingers, 0.0)
        self._diagnosed_at = -DIAGNOSTICS_INTERVAL

    def __enter__(self) -> Self:
        self._transport = _join(self._over, self._domain)
        writer = self._transport.writer
        if self._publishes:
            self._writers = {
                (finger, suffix): writer(f"tactophone/{finger}/{suffix}", kind)
                for finger in self._reader.fingers
                for suffix, kind in (
                    ("prediction", messages.Float32MultiArray), ("vibration", messages.Float32MultiArray),
                    ("roughness", messages.Float32), ("contact_dbfs", messages.Float32),
                    ("audio", messages.AudioDataStamped),
                )
            }  # fmt: skip
            self._diagnostics = writer("diagnostics", messages.DiagnosticArray)
            # Kept, as a latched message lives as long as its writer.
            self._infos = [
                writer(f"tactophone/{finger}/audio_info", messages.AudioInfo, latched=True)
                for finger in self._reader.fingers
            ]
            for info in self._infos:
                info.write(messages.AudioInfo(2, LIVE_SAMPLE_RATE, "S16LE", 0, "wave"))
        self._devices = [(sink, writer(sink.topic, sink.kind)) for sink in self._sinks]
        self._requests = {
            action: self._transport.reader(f"tactophone/{action}", messages.Empty) for action in ("stop", "mute")
        }
        return self

    def __exit__(self, *_: object) -> None:
        self._command(dict.fromkeys(self._reader.fingers, 0.0))
        self._transport.close()

    def read(self) -> None:
        """Pass on what is new, and obey a stop or a mute."""
        self._obey()
        found = self._reader.read()
        for finger, newest in found.items():
            if self._publishes:
                self._publish(finger, newest)
        if found:
            self._command({finger: newest.command.amplitude for finger, newest in found.items()})
        if self._publishes:
            now = time.time()
            for place, finger in enumerate(self._reader.fingers):
                self._publish_sound(place, finger, now)
            self._diagnose(now)

    def _obey(self) -> None:
        for action, reader in self._requests.items():
            # Whatever a stranger sends in numbers, one read takes some of it and asks once.
            if reader.take(N=10):
                self._reader.stop() if action == "stop" else self._reader.mute()

    def _command(self, amplitudes: dict[str, float]) -> None:
        self._beat += 1
        self._amplitudes |= {finger: min(max(amplitude, 0.0), 1.0) for finger, amplitude in amplitudes.items()}
        for sink, writer in self._devices:
            writer.write(sink.make(self._amplitudes, self._beat))

    def _publish(self, finger: str, newest: Newest) -> None:
        prediction, command = newest.prediction, newest.command
        for suffix, message in (
            ("prediction", messages.Float32MultiArray(data=list(prediction.probabilities))),
            ("vibration", messages.Float32MultiArray(data=[command.amplitude, command.frequency])),
            ("roughness", messages.Float32(newest.roughness)),
            ("contact_dbfs", messages.Float32(max(prediction.level_dbfs, -200.0))),
        ):
            self._writers[finger, suffix].write(message)

    def _publish_sound(self, place: int, finger: str, now: float) -> None:
        before = self._snapshots.get(finger)
        snapshot = self._snapshots[finger] = self._reader.watcher.snapshot(before, finger=place)
        if before is None or not len(snapshot.sound):
            return
        # The newest sample is about now; the first, as long ago as there are samples.
        stamp = now - len(snapshot.sound) / LIVE_SAMPLE_RATE
        samples = (np.clip(snapshot.sound, -1, 1) * 32_767).astype("<i2")
        audio = messages.AudioData(data=list(samples.tobytes()))
        self._writers[finger, "audio"].write(messages.AudioDataStamped(_header(stamp), audio))

    def _diagnose(self, now: float) -> None:
        if time.monotonic() - self._diagnosed_at < DIAGNOSTICS_INTERVAL:
            return
        self._diagnosed_at = time.monotonic()
        state = self._reader.state()
        counters, _ = self._reader.watcher.totals()
        values = {"armed": str(state.armed).lower(), "muted_because": state.muted_because, "link": state.link}
        values |= {name: str(value) for name, value in counters.items() if value}
        self._diagnostics.write(
            messages.DiagnosticArray(
                _header(now),
                [
                    messages.DiagnosticStatus(
                        level=1 if state.faults else 0,
                        name=f"tactophone: {self._name}",
                        message="; ".join(fault.text for fault in state.faults) or "OK",
                        hardware_id=",".join(self._reader.fingers),
                        values=[messages.KeyValue(key, value) for key, value in values.items()],
                    )
                ],
            )
        )


def _header(now: float) -> messages.Header:
    return messages.Header(messages.Time(int(now), int(now % 1 * 1e9)), "fingertip")


def _join(over: str, domain: int) -> Transport:
    if over == "zenoh":
        from tactophone.bridges.ros.zenoh import ZenohTransport  # its library is an extra of its own

        return ZenohTransport(domain)
    return DdsTransport(domain)
