"""Commands as the frames that XR_EXT_haptic_parametric (OpenXR 1.1.60, revision 1)
takes.

The structure is described in the registry, ``XrHapticParametricVibrationEXT``: points
of amplitude and of frequency, each 0 to 1, with times in ns from the start of the
frame; the frequency lies between two bounds in Hz. A runtime holds the vibration for 50
ms after a frame and then stops it: a dead-man in the standard.
"""

import enum
import math
from collections.abc import Iterable
from dataclasses import dataclass

from tactophone import HapticCommand

MOST_POINTS = 500
"""``XR_HAPTIC_PARAMETRIC_MAX_POINTS_TRANSIENTS_EXT``: of each kind, in a call."""

LOWEST_HZ = 1.0
"""``XR_HAPTIC_PARAMETRIC_FREQUENCY_MIN_HZ_EXT``."""

HIGHEST_HZ = 1000.0
"""``XR_HAPTIC_PARAMETRIC_FREQUENCY_MAX_HZ_EXT``."""

HELD = 0.05
"""``XR_HAPTIC_PARAMETRIC_VIBRATION_EXTEND_DURATION_EXT``, in s."""

STALE = HELD
"""Seconds after which an old command is silence in a frame; with `HELD`, nothing
outlasts its command by over 0.1 s."""

PULSES = 16.0
"""Hz at which `patterned` pulses what is rough: a runtime that knows one frequency
shows it as loudness, in time."""

ROUGH_HZ = 90.0
"""Between the paper's frequencies of rough (60 Hz) and smooth (120 Hz)."""

Point = tuple[int, float]


class FrameType(enum.IntEnum):
    """``XrHapticParametricStreamFrameTypeEXT``."""

    NONE = 0
    FIRST = 1
    INTERMEDIATE = 2
    LAST = 3


@dataclass(frozen=True, slots=True)
class Frame:
    """The fields of ``XrHapticParametricVibrationEXT``; a point is ``(ns, 0 to 1)``."""

    amplitude_points: tuple[Point, ...]
    frequency_points: tuple[Point, ...]
    min_frequency_hz: float
    max_frequency_hz: float
    type: FrameType


class HapticStream:
    """Makes frames of commands, one frame for each stretch of time.

    ``lowest`` and ``highest`` are the device's band in Hz
    (``XrHapticParametricPropertiesEXT``); ``pulsed`` is for runtimes that ignore the
    frequency.
    """

    def __init__(
        self, *, lowest: float = 40.0, highest: float = 400.0, pulsed: bool = False
    ) -> None:
        if not LOWEST_HZ <= lowest < highest <= HIGHEST_HZ:
            raise ValueError(
                f"a band of {lowest} to {highest} Hz; wanted {LOWEST_HZ:.0f} <= lowest "
                f"< highest <= {HIGHEST_HZ:.0f}"
            )
        self._lowest, self._highest, self._pulsed = lowest, highest, pulsed
        self._begun = False
        self._held = HapticCommand(0.0, lowest, -math.inf)

    def frame(
        self, commands: Iterable[HapticCommand], begin: float, end: float
    ) -> Frame:
        """Return the frame from ``begin`` to ``end`` (s), with the commands whose time
        lies in it, oldest first."""
        amplitudes: list[Point] = [(0, self._amplitude(self._held, begin))]
        frequencies: list[Point] = [(0, self._frequency(self._held))]
        silence = HapticCommand(0.0, self._lowest, begin)
        for given in commands:
            finite = all(
                map(math.isfinite, (given.amplitude, given.frequency, given.time))
            )
            self._held = command = given if finite else silence
            at = max(0, round((command.time - begin) * 1e9))
            if at > (end - begin) * 1e9 or len(amplitudes) >= MOST_POINTS - 1:
                continue
            for points, value in (
                (amplitudes, self._amplitude(command, command.time)),
                (frequencies, self._frequency(command)),
            ):
                if at > points[-1][0]:
                    points.append((at, value))
                else:  # the newest of one moment
                    points[-1] = (points[-1][0], value)
        last = max(1, round((end - begin) * 1e9))
        if last > amplitudes[-1][0]:
            amplitudes.append((last, self._amplitude(self._held, end)))
        kind = FrameType.INTERMEDIATE if self._begun else FrameType.FIRST
        self._begun = True
        return self._made(amplitudes, frequencies, kind)

    def finish(self) -> Frame:
        """Return the frame that ends the stream, in silence; the next one begins
        another stream."""
        self._begun = False
        self._held = HapticCommand(0.0, self._lowest, -math.inf)
        return self._made([(0, 0.0), (1_000_000, 0.0)], [(0, 0.0)], FrameType.LAST)

    def _made(
        self, amplitudes: list[Point], frequencies: list[Point], kind: FrameType
    ) -> Frame:
        return Frame(
            tuple(amplitudes), tuple(frequencies), self._lowest, self._highest, kind
        )

    def _amplitude(self, command: HapticCommand, moment: float) -> float:
        if moment - command.time > STALE:
            return 0.0
        level = min(max(command.amplitude, 0.0), 1.0)
        return patterned(level, command.frequency, moment) if self._pulsed else level

    def _frequency(self, command: HapticCommand) -> float:
        place = (command.frequency - self._lowest) / (self._highest - self._lowest)
        return 0.0 if self._pulsed else min(max(place, 0.0), 1.0)


def patterned(amplitude: float, frequency: float, moment: float) -> float:
    """Return an amplitude that tells rough from smooth without a frequency: rough
    pulses, smooth is steady."""
    if frequency >= ROUGH_HZ:
        return amplitude
    return amplitude if moment * PULSES % 1 < 0.5 else 0.0
