"""Channels that no model is trained on: telephone, codecs, rooms, clipping, a motor, wind and a phone's gain control.

They were written down before any model was trained on varied waveforms, so that no choice could be made by them. What
training varies (`tactophone.training.sets`: low-pass, noise, equaliser, speed, one simple room) is not among them. Each
is a function of sound ``(samples, channels)``, its rate and a random generator; level and length stay about the same.
"""

import io
import zlib
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import soundfile
from numpy.typing import NDArray
from scipy import signal
from scipy.linalg import solve_toeplitz

from tactophone.dataset.values import Recording
from tactophone.link.codec import Codec, encode_and_decode
from tactophone.microphones import AIR
from tactophone.types import LIVE_SAMPLE_RATE

Sound = NDArray[np.float64]
Distortion = Callable[[Sound, int, np.random.Generator], Sound]


def _resampled(sound: Sound, rate: int, other: int, size: int | None = None) -> Sound:
    divisor = np.gcd(rate, other)
    found = signal.resample_poly(sound, other // divisor, rate // divisor, axis=0)
    return found if size is None else np.pad(found[:size], ((0, max(0, size - len(found))), (0, 0)))


def _rms(sound: Sound) -> float:
    return float(np.sqrt(np.mean(np.square(sound)))) + 1e-9


def telephone(sound: Sound, rate: int, rng: np.random.Generator) -> Sound:
    """A line of ITU-T G.711: 8 kHz, 300 to 3400 Hz, mu-law of 8 bits."""
    narrow = signal.sosfiltfilt(
        signal.butter(4, (300, 3400), "bandpass", fs=8000, output="sos"), _resampled(sound, rate, 8000), axis=0
    )
    peak = np.abs(narrow).max() / 0.7 + 1e-9
    coded = np.sign(narrow) * np.log1p(255 * np.minimum(np.abs(narrow) / peak, 1)) / np.log(256)
    coded = np.round(coded * 127) / 127
    return _resampled(np.sign(coded) * np.expm1(np.abs(coded) * np.log(256)) / 255 * peak, 8000, rate, len(sound))


def mobile(sound: Sound, rate: int, rng: np.random.Generator) -> Sound:
    """A mobile telephone's band and spectrum, as of AMR at 12.2 kbit/s: the envelope of a 10th order linear prediction
    every 20 ms, its residual quantised to 2 bits a sample."""
    band = signal.butter(6, (300, 3400), "bandpass", fs=8000, output="sos")
    narrow = signal.sosfilt(band, _resampled(sound, rate, 8000), axis=0)
    for channel in range(narrow.shape[1]):
        state = np.zeros(10)
        back = np.zeros(10)
        for begin in range(0, len(narrow), 160):
            frame = narrow[begin : begin + 160, channel]
            shifted = [frame[lag:] @ frame[: len(frame) - lag] for lag in range(11)]
            shifted[0] = shifted[0] * 1.0001 + 1e-9
            if len(frame) < 11:
                break
            filter_ = np.concatenate(([1.0], -solve_toeplitz(shifted[:-1], shifted[1:])))
            residual, state = signal.lfilter(filter_, 1, frame, zi=state)
            step = 0.9957 * _rms(residual)  # of a uniform quantiser with four levels, for a Gaussian (Max 1960)
            coarse = (np.clip(np.floor(residual / step), -2, 1) + 0.5) * step
            narrow[begin : begin + 160, channel], back = signal.lfilter([1], filter_, coarse, zi=back)
    return _resampled(narrow, 8000, rate, len(sound))


def opus(sound: Sound, rate: int, rng: np.random.Generator) -> Sound:
    """Opus at 16 kbit/s a channel."""
    channels = sound.shape[1]
    codec = Codec("opus", channels=channels, packet_size=960, bitrate_bps=16_000 * channels, bandwidth=20_000)
    at_rate = _resampled(sound, rate, LIVE_SAMPLE_RATE).astype(np.float32)
    return _resampled(encode_and_decode(at_rate, codec).astype(float), LIVE_SAMPLE_RATE, rate, len(sound))


def mp3(sound: Sound, rate: int, rng: np.random.Generator) -> Sound:
    """MP3 at its 16 kbit/s and 16 kHz."""
    file = io.BytesIO()
    narrow = np.clip(_resampled(sound, rate, 16_000), -1, 1)
    settings = {"compression_level": 0.95, "bitrate_mode": "CONSTANT"}
    soundfile.write(file, narrow, 16_000, format="MP3", subtype="MPEG_LAYER_III", **settings)
    file.seek(0)
    found, _ = soundfile.read(file, always_2d=True)
    # The decoder delays; where the two agree best.
    place = signal.correlate(found[:, 0], narrow[:, 0], "full", "fft")[len(narrow) - 1 :][:4000].argmax()
    return _resampled(found[place:], 16_000, rate, len(sound))


def _room(sound: Sound, rate: int, rng: np.random.Generator, *, decay: float, direct_db: float) -> Sound:
    """Air alone: exponentially decaying noise after the direct sound, longer at low frequencies."""
    time = np.arange(round(1.2 * decay * rate)) / rate
    tail = rng.standard_normal(len(time)) * np.exp(-6.9 * time / decay)
    dull = signal.sosfilt(signal.butter(1, 2000, fs=rate, output="sos"), tail)
    tail = tail * np.exp(-6.9 * time / decay) + dull
    tail[: round(0.002 * rate)] = 0
    tail *= 10 ** (-direct_db / 20) / np.sqrt(np.square(tail).sum())
    air = AIR if sound.shape[1] > 1 else 0
    found = sound.copy()
    found[:, air] += signal.fftconvolve(sound[:, air], tail)[: len(sound)]
    return found


def office(sound: Sound, rate: int, rng: np.random.Generator) -> Sound:
    """A room of 0.4 s of reverberation, direct sound 6 dB over the rest."""
    return _room(sound, rate, rng, decay=0.4, direct_db=6.0)


def hall(sound: Sound, rate: int, rng: np.random.Generator) -> Sound:
    """A room of 1.5 s of reverberation, as loud as the direct sound."""
    return _room(sound, rate, rng, decay=1.5, direct_db=0.0)


def clipped(sound: Sound, rate: int, rng: np.random.Generator) -> Sound:
    """Each channel clipped where one sample in a hundred lies over it."""
    limit = np.quantile(np.abs(sound), 0.99, axis=0)
    return np.clip(sound, -limit, limit)


def motor(sound: Sound, rate: int, rng: np.random.Generator) -> Sound:
    """Another finger's motor, 6 dB under the take: 30 harmonics of 60 to 260 Hz, whose speed changes three times a
    second, and mains hum."""
    time = np.arange(len(sound)) / rate
    knots = np.arange(0, time[-1] + 1, 1 / 3)
    speed = np.interp(time, knots, rng.uniform(60, 260, len(knots)))
    phase = 2 * np.pi * np.cumsum(speed) / rate
    tone = sum(np.sin(k * phase + rng.uniform(0, 6.3)) / k**0.7 for k in range(1, 31)) * (speed / 160)
    tone = tone / _rms(tone) + 0.3 * np.sin(2 * np.pi * 50 * time) + 0.2 * np.sin(2 * np.pi * 150 * time)
    return sound + tone[:, None] * [0.5 * _rms(channel) for channel in sound.T]


def wind(sound: Sound, rate: int, rng: np.random.Generator) -> Sound:
    """Bursts of noise under 150 Hz, 10 dB over the take while they last; air alone."""
    low = signal.sosfilt(signal.butter(2, 150, fs=rate, output="sos"), rng.standard_normal(len(sound)))
    knots = np.arange(0, len(sound) / rate + 1, 0.4)
    gusts = np.interp(np.arange(len(sound)) / rate, knots, rng.uniform(-1, 1, len(knots)).clip(0))
    air = AIR if sound.shape[1] > 1 else 0
    found = sound.copy()
    found[:, air] += low / _rms(low) * gusts * 3.2 * _rms(sound[:, air])
    return found


def gain_control(sound: Sound, rate: int, rng: np.random.Generator) -> Sound:
    """A phone's gain control: towards -20 dBFS, at most 30 dB up, down in 5 ms and up in 0.3 s; its noise comes up."""
    noisy = sound + rng.standard_normal(sound.shape) * 10 ** (-75 / 20)
    step = rate // 1000
    level = np.sqrt(np.square(noisy[: len(noisy) // step * step]).reshape(-1, step, sound.shape[1]).mean(1)) + 1e-6
    held = level.copy()
    for k in range(1, len(held)):
        held[k] += (held[k - 1] - held[k]) * np.where(held[k] > held[k - 1], np.exp(-1 / 5), np.exp(-1 / 300))
    gain = np.minimum(0.1 / held, 10**1.5).repeat(step, axis=0)
    return np.clip(noisy * np.pad(gain, ((0, len(sound) - len(gain)), (0, 0)), "edge"), -1, 1)


DISTORTIONS: dict[str, Distortion] = {
    each.__name__.replace("_", " "): each
    for each in (telephone, mobile, opus, mp3, office, hall, clipped, motor, wind, gain_control)
}


def distorted(recording: Recording, name: str, folder: Path) -> Recording:
    """Write a recording as a channel leaves it; the same recording is always distorted alike."""
    path = folder / name / f"{recording.surface}_{recording.path.parent.name}_{recording.path.stem}.wav"
    if not path.exists():
        path.parent.mkdir(parents=True, exist_ok=True)
        sound, rate = soundfile.read(recording.path, always_2d=True)
        rng = np.random.default_rng(zlib.crc32(path.name.encode()))
        soundfile.write(path, DISTORTIONS[name](sound, rate, rng), rate, subtype="FLOAT")
    return replace(recording, path=path)
