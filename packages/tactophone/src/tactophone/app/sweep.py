"""What an actuator plays, measured: a sweep goes out, an input records it, and
resonance and band are fitted."""

import math
import threading
from collections.abc import Callable
from contextlib import closing
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from tactophone.core.errors import DeviceError
from tactophone.core.types import LIVE_SAMPLE_RATE, FloatArray
from tactophone.live.audio.device import Device, Process

LOWEST = 35.0
"""Hz at which a sweep begins: the lower limit of the vibration (`haptics.Limits`)."""

HIGHEST = 800.0
"""Hz at which it ends: a finger feels little above (Verrillo 1963)."""

SWEEP_DURATION = 8.0
"""Seconds of a sweep: 1.7 s an octave, slow enough for an actuator of Q 20 at 30 Hz to
follow."""

BAND_DB = 10.0
"""The band ends where the level is this far below the resonance's, in dB."""

LEAST_SNR_DB = 12.0
"""The resonance must stand this far over the noise that is recorded before the sweep,
in dB."""

POINTS = 48
"""Levels per sweep: ten an octave."""

_PAUSE = 0.5
"""Seconds of silence before the sweep, to measure the noise, and after it, as the way
back takes time."""


@dataclass(frozen=True, slots=True)
class MeasuredResponse:
    """Levels in dB relative to the strongest, at rising frequencies in Hz, and what was
    fitted to them."""

    frequencies: tuple[float, ...]
    levels_db: tuple[float, ...]
    resonance: float
    lowest: float
    highest: float
    snr_db: float


def sweep(amplitude: float, *, duration: float = SWEEP_DURATION) -> FloatArray:
    """Return an exponential sine sweep from `LOWEST` to `HIGHEST`, faded over 50 ms,
    with silence before and after.

    After Farina, "Simultaneous measurement of impulse response and distortion with a
    swept-sine technique" (AES 2000).
    """
    time_axis = np.arange(round(duration * LIVE_SAMPLE_RATE)) / LIVE_SAMPLE_RATE
    rate = math.log(HIGHEST / LOWEST)
    phase = 2 * np.pi * LOWEST * duration / rate * np.expm1(time_axis * rate / duration)
    edge = np.minimum(1.0, np.minimum(time_axis, duration - time_axis) / 0.05)
    silence = np.zeros(round(_PAUSE * LIVE_SAMPLE_RATE))
    return np.concatenate([silence, amplitude * edge * np.sin(phase), silence]).astype(
        np.float32
    )


def fit(recorded: FloatArray, *, duration: float = SWEEP_DURATION) -> MeasuredResponse:
    """Fit resonance and band to the recording of a `sweep`, shape ``(samples,)``.

    At each frequency the recording is correlated with a sine of it while the sweep
    passes, so neither noise of other frequencies nor the delay of the way back matters.
    Raises `DeviceError` if nothing stands out of the noise.
    """
    noise = recorded[: round(0.8 * _PAUSE * LIVE_SAMPLE_RATE)]
    frequencies = np.geomspace(LOWEST * 1.1, HIGHEST / 1.1, POINTS)
    amplitudes = np.array(
        [_amplitude(recorded, frequency, duration) for frequency in frequencies]
    )
    floor = max(float(np.sqrt(2) * noise.std()), 1e-9)
    peak = int(np.argmax(amplitudes))
    snr_db = 20 * math.log10(max(float(amplitudes[peak]), 1e-12) / floor)
    if snr_db < LEAST_SNR_DB:
        raise DeviceError(
            f"the sweep stands only {snr_db:.0f} dB over the noise, but "
            f"{LEAST_SNR_DB:.0f} are needed: press the microphone on the actuator, or "
            "raise --amplitude"
        )
    levels = 20 * np.log10(np.maximum(amplitudes, 1e-12) / amplitudes[peak])
    inside = np.flatnonzero(levels >= -BAND_DB)
    resonance = _vertex(np.log(frequencies), levels, peak)
    band = float(frequencies[inside[0]]), float(frequencies[inside[-1]])
    return MeasuredResponse(
        tuple(frequencies), tuple(levels), math.exp(resonance), *band, snr_db=snr_db
    )


def _amplitude(recorded: FloatArray, frequency: float, duration: float) -> float:
    """Return the greatest amplitude of a frequency around the moment at which the sweep
    passes it."""
    passes = _PAUSE + duration * math.log(frequency / LOWEST) / math.log(
        HIGHEST / LOWEST
    )
    width = round(min(0.5, max(0.1, 12 / frequency)) * LIVE_SAMPLE_RATE)
    # Sound cards delay by up to 0.3 s: the loudest of several windows is that at which
    # the sweep passes.
    starts = (
        round(passes * LIVE_SAMPLE_RATE)
        - width // 2
        + np.arange(0, LIVE_SAMPLE_RATE * 3 // 10, width // 4)
    )
    window = np.hanning(width)
    probe = (
        window
        * np.exp(-2j * np.pi * frequency * np.arange(width) / LIVE_SAMPLE_RATE)
        * 2
        / window.sum()
    )
    found = [
        abs(recorded[start : start + width] @ probe)
        for start in starts
        if 0 <= start <= len(recorded) - width
    ]
    return max(found, default=0.0)


def _vertex(x: NDArray[np.float64], y: NDArray[np.float64], peak: int) -> float:
    """Return where the parabola through a peak and its neighbours is highest."""
    if not 0 < peak < len(x) - 1:
        return float(x[peak])
    below, top, above = y[peak - 1 : peak + 2]
    curvature = below - 2 * top + above
    return float(
        x[peak]
        + (0.0 if curvature == 0 else 0.5 * (below - above) / curvature)
        * (x[peak] - x[peak - 1])
    )


class SweepRecorder:
    """Plays a waveform once on one device while it records another; both run in the
    devices' threads.

    The waveform, shape ``(samples,)``, is played as it is, so the caller bounds it.
    """

    def __init__(self, waveform: FloatArray) -> None:
        self._waveform = waveform
        self._played = 0
        self._recorded: list[FloatArray] = []
        self._ended = threading.Event()

    def play(self, out: FloatArray) -> None:
        """Write the next samples; silence after the end."""
        part = self._waveform[self._played : self._played + len(out)]
        out[: len(part)] = part
        out[len(part) :] = 0.0
        self._played += len(out)
        if self._played >= len(self._waveform):
            self._ended.set()

    def record(self, inputs: list[FloatArray], _: list[FloatArray]) -> None:
        """Keep the first input's samples from the moment at which the waveform
        starts."""
        if self._played and not self._ended.is_set():
            self._recorded.append(inputs[0].copy())

    def run(
        self, open_input: Callable[[Process], Device], open_output: Callable[[], Device]
    ) -> FloatArray:
        with (
            closing(open_input(self.record)) as microphone,
            closing(open_output()) as actuator,
        ):
            microphone.open()
            actuator.open()
            if not self._ended.wait(len(self._waveform) / LIVE_SAMPLE_RATE + 5):
                raise DeviceError(
                    "the sound card stopped during the sweep: see `tactophone devices`"
                )
        return (
            np.concatenate(self._recorded)
            if self._recorded
            else np.zeros(0, np.float32)
        )
