"""The two motors of a gamepad, by force feedback of Linux (`evdev`), as a device that
requests the waveform.

Each effect lasts `EFFECT` and is refreshed every `REFRESH`, so a process that dies
leaves a pad that falls silent by itself. The strength comes from the rendered waveform,
behind every limit, fade and stop; roughness only divides it between the motors.
"""

import contextlib
import time
from collections.abc import Callable
from typing import Any

import numpy as np

from tactophone.core.errors import DeviceError
from tactophone.core.types import LIVE_SAMPLE_RATE
from tactophone.live.audio.device import Process, ThreadedDevice

EFFECT = 0.12
"""Seconds of an effect: it lasts over one missed refresh."""

REFRESH = 0.05
"""Seconds between two effects; a motor takes about as long to change its speed."""

EXPONENT = 0.4
"""Compresses the range: the faint end of the paper's profile, -25 dB of the ceiling,
becomes -10 dB, a third of it, at which motors turn."""

_PERIOD = round(REFRESH * LIVE_SAMPLE_RATE / 10)
"""Samples of a period: ten between two effects."""

_FULL = 0xFFFF
"""Level of a motor at full strength, in evdev's 16 bits."""


def motor_levels(
    amplitude: float, roughness: float, ceiling: float
) -> tuple[float, float]:
    """Return the levels, 0 to 1, of the strong (slow) motor and of the weak (fast) one;
    never above the ceiling.

    Rough turns the strong motor, smooth the weak one, and both share what lies between.

    >>> motor_levels(0.5, 1.0, 0.5), motor_levels(0.0, 1.0, 0.5)
    ((0.5, 0.0), (0.0, 0.0))
    >>> [round(level, 2) for level in motor_levels(0.5 * 10 ** (-25 / 20), 0.0, 0.5)]
    [0.0, 0.16]
    """
    if not (amplitude > 0 and ceiling > 0):
        return 0.0, 0.0
    drive = ceiling * min(1.0, amplitude / ceiling) ** EXPONENT
    share = min(max(roughness, 0.0), 1.0)
    return drive * share, drive * (1 - share)


class GamepadDevice(ThreadedDevice):
    """A `tactophone.live.audio.device.Device` on a gamepad's motors.

    It reconnects to the pad that it began with and to no other of another name.

    - ``process``: called each period of 5 ms; see
      `tactophone.live.audio.device.Process`.
    - ``device``: part of the pad's name, or its path under ``/dev/input``; empty for
      the first pad with motors.
    - ``roughness``: returns the roughness of the newest prediction, 0 to 1.
    - ``ceiling``: returns the greatest amplitude that is now allowed, 0 to 1 of full
      drive.
    - ``find``: returns the pads with motors; by default the ones that `evdev` lists.
    """

    latency = REFRESH

    def __init__(
        self,
        process: Process,
        *,
        device: str = "",
        roughness: Callable[[], float],
        ceiling: Callable[[], float],
        find: Callable[[], list[Any]] | None = None,
    ) -> None:
        super().__init__(process, thread="actuator")
        self._device = device
        self._find = find or _pads
        self._roughness = roughness
        self._ceiling = ceiling
        self._pad: Any = None
        self._held = ""
        """Name of the pad that it began with; empty before."""
        self._others = ""
        """What pads there are while that one is gone."""
        self._effect = -1

    @property
    def lost(self) -> bool:
        return self._pad is None

    @property
    def fault(self) -> str:
        if not self.lost:
            return ""
        which = f"{self._held} is gone" if self._held else "the gamepad is gone"
        others = f"; there are: {self._others}" if self._others else ""
        return (
            f"{which}{others}: connect it again, and the vibration returns; "
            "to use another, start the run again"
        )

    def open(self) -> None:
        self._pad = self._choose()
        super().open()

    def revive(self) -> None:
        if self.lost:
            with contextlib.suppress(DeviceError):
                self._pad = self._choose()

    def close(self) -> None:
        super().close()
        if self._pad is not None:
            self._play(0.0, 0.0)
            with contextlib.suppress(OSError):
                self._pad.close()
            self._pad = None

    def _choose(self) -> Any:
        pads = self._find()
        for pad in pads:
            if self._fits(pad):
                self._effect = -1
                self._held = pad.name
                self._others = ""
                return pad
        self._others = "; ".join(f"{pad.path} {pad.name}" for pad in pads)
        listed = self._others or "none (may this user read /dev/input?)"
        raise DeviceError(
            f"no gamepad with motors matches {self._device or 'any'!r}; "
            f"there are: {listed}"
        )

    def _fits(self, pad: Any) -> bool:
        """Return whether a pad is the one that it began with or, at first, the one that
        was asked for: a path may be another pad's by now."""
        if self._held:
            return bool(pad.name == self._held)
        return self._device.lower() in pad.name.lower() or self._device == pad.path

    def _run(self) -> None:
        waveform = np.zeros((1, _PERIOD), np.float32)
        due = time.monotonic()
        peak = 0.0
        turning = False
        refreshed = 0.0
        while not self._ended.wait(max(0.0, due - time.monotonic())):
            now = time.monotonic()
            if now - due > EFFECT:
                self.xruns += 1
                due = now
            self._render(waveform)
            # A waveform that is not finite is a fault, and silent as everywhere; `max`
            # would keep it.
            rendered = float(np.abs(waveform).max())
            rendered = rendered if np.isfinite(rendered) else 0.0
            peak = max(peak, rendered)
            due += _PERIOD / LIVE_SAMPLE_RATE
            # What was playing and has ended rests at once. A vibration between two
            # effects is over when it is played: it turns the motors for one `REFRESH`.
            over = turning and not rendered
            if over or now - refreshed >= REFRESH:
                peak = 0.0 if over else peak
                self._play(*motor_levels(peak, self._roughness(), self._ceiling()))
                turning = rendered > 0
                peak = 0.0
                refreshed = now

    def _play(self, strong: float, weak: float) -> None:
        """Start an effect in place of the last one; a pad that is gone is a fault, not
        an error."""
        pad = self._pad
        if pad is None:
            return
        try:
            from evdev import ecodes, ff

            rumble = ff.EffectType(
                ff_rumble_effect=ff.Rumble(round(strong * _FULL), round(weak * _FULL))
            )
            replay = ff.Replay(round(1000 * EFFECT), 0)
            # An upload with the id of a playing effect replaces it; playing it again
            # starts its time anew.
            effect = ff.Effect(
                ecodes.FF_RUMBLE, self._effect, 0, ff.Trigger(0, 0), replay, rumble
            )
            self._effect = pad.upload_effect(effect)
            pad.write(ecodes.EV_FF, self._effect, 1)
        except OSError:
            self.losses += 1
            self._pad = None


def _pads() -> list[Any]:
    try:
        import evdev
    except ImportError:
        raise DeviceError(
            "evdev is not installed: `pip install 'tactophone[gamepad]'`"
        ) from None
    found = []
    for path in evdev.list_devices():
        pad = evdev.InputDevice(path)
        if evdev.ecodes.FF_RUMBLE in pad.capabilities().get(evdev.ecodes.EV_FF, []):
            found.append(pad)
        else:
            pad.close()
    return found
