"""Channels that no model is trained on: telephone, codecs, rooms, clipping, a motor,
wind and a phone's gain control.

They were written down before any model was trained on varied waveforms, so that no
choice could be made by them. What training varies
(`tactophone_lab.training.augmentation`: low-pass, noise, equaliser, speed, one simple
room) is not among them. Each is a function of sound ``(samples, channels)``, its rate
and a random generator; level and length stay about the same.

These *ten* have been looked at often. Eight more were written down before any of them
was scored, in four pairs: coded (headset, old headset), quiet sound lost (conference,
recorder), filtered (port, table), disturbed (lost packets, supply). Of each pair the
first by alphabet is for *development*: designs may be chosen by it. The other is
*kept*, and is scored once for each design that is adopted.

The group *robot*, added later, needs TACTOPHONE_RECORDINGS with `gripper`: its motion
in the air and the noise around it, 10 dB under the take, in the contact channel.
"""

import io
import os
import sys
import zlib
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import soundfile
from numpy.lib.stride_tricks import sliding_window_view
from numpy.typing import NDArray
from scipy import signal
from scipy.linalg import solve_toeplitz

from tactophone.core.microphones import AIR
from tactophone.core.recordings.values import Recording
from tactophone.core.types import LIVE_SAMPLE_RATE
from tactophone.net.link.codec import Codec, encode_and_decode

Sound = NDArray[np.float64]
Distortion = Callable[[Sound, int, np.random.Generator], Sound]


def _resampled(sound: Sound, rate: int, other: int, size: int | None = None) -> Sound:
    divisor = np.gcd(rate, other)
    found = signal.resample_poly(sound, other // divisor, rate // divisor, axis=0)
    return (
        found
        if size is None
        else np.pad(found[:size], ((0, max(0, size - len(found))), (0, 0)))
    )


def _rms(sound: Sound) -> float:
    return float(np.sqrt(np.mean(np.square(sound)))) + 1e-9


def telephone(sound: Sound, rate: int, rng: np.random.Generator) -> Sound:
    """A line of ITU-T G.711: 8 kHz, 300 to 3400 Hz, mu-law of 8 bits."""
    narrow = signal.sosfiltfilt(
        signal.butter(4, (300, 3400), "bandpass", fs=8000, output="sos"),
        _resampled(sound, rate, 8000),
        axis=0,
    )
    peak = np.abs(narrow).max() / 0.7 + 1e-9
    coded = (
        np.sign(narrow)
        * np.log1p(255 * np.minimum(np.abs(narrow) / peak, 1))
        / np.log(256)
    )
    coded = np.round(coded * 127) / 127
    return _resampled(
        np.sign(coded) * np.expm1(np.abs(coded) * np.log(256)) / 255 * peak,
        8000,
        rate,
        len(sound),
    )


def mobile(sound: Sound, rate: int, rng: np.random.Generator) -> Sound:
    """A mobile telephone's band and spectrum, as of AMR at 12.2 kbit/s: the envelope of
    a 10th order linear prediction every 20 ms, its residual quantised to 2 bits a
    sample."""
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
            filter_ = np.concatenate(
                ([1.0], -solve_toeplitz(shifted[:-1], shifted[1:]))
            )
            residual, state = signal.lfilter(filter_, 1, frame, zi=state)
            step = 0.9957 * _rms(
                residual
            )  # of a uniform quantiser with four levels, for a Gaussian (Max 1960)
            coarse = (np.clip(np.floor(residual / step), -2, 1) + 0.5) * step
            narrow[begin : begin + 160, channel], back = signal.lfilter(
                [1], filter_, coarse, zi=back
            )
    return _resampled(narrow, 8000, rate, len(sound))


def opus(sound: Sound, rate: int, rng: np.random.Generator) -> Sound:
    """Opus at 16 kbit/s a channel."""
    channels = sound.shape[1]
    codec = Codec(
        "opus",
        channels=channels,
        packet_size=960,
        bitrate_bps=16_000 * channels,
        bandwidth=20_000,
    )
    at_rate = _resampled(sound, rate, LIVE_SAMPLE_RATE).astype(np.float32)
    return _resampled(
        encode_and_decode(at_rate, codec).astype(float),
        LIVE_SAMPLE_RATE,
        rate,
        len(sound),
    )


def mp3(sound: Sound, rate: int, rng: np.random.Generator) -> Sound:
    """MP3 at its 16 kbit/s and 16 kHz."""
    file = io.BytesIO()
    narrow = np.clip(_resampled(sound, rate, 16_000), -1, 1)
    settings = {"compression_level": 0.95, "bitrate_mode": "CONSTANT"}
    soundfile.write(
        file, narrow, 16_000, format="MP3", subtype="MPEG_LAYER_III", **settings
    )
    file.seek(0)
    found, _ = soundfile.read(file, always_2d=True)
    # The decoder delays; where the two agree best.
    place = signal.correlate(found[:, 0], narrow[:, 0], "full", "fft")[
        len(narrow) - 1 :
    ][:4000].argmax()
    return _resampled(found[place:], 16_000, rate, len(sound))


def _room(
    sound: Sound, rate: int, rng: np.random.Generator, *, decay: float, direct_db: float
) -> Sound:
    """Air alone: exponentially decaying noise after the direct sound, longer at low
    frequencies."""
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
    """Another finger's motor, 6 dB under the take: 30 harmonics of 60 to 260 Hz, whose
    speed changes three times a second, and mains hum."""
    time = np.arange(len(sound)) / rate
    knots = np.arange(0, time[-1] + 1, 1 / 3)
    speed = np.interp(time, knots, rng.uniform(60, 260, len(knots)))
    phase = 2 * np.pi * np.cumsum(speed) / rate
    tone = sum(
        np.sin(k * phase + rng.uniform(0, 6.3)) / k**0.7 for k in range(1, 31)
    ) * (speed / 160)
    tone = (
        tone / _rms(tone)
        + 0.3 * np.sin(2 * np.pi * 50 * time)
        + 0.2 * np.sin(2 * np.pi * 150 * time)
    )
    return sound + tone[:, None] * [0.5 * _rms(channel) for channel in sound.T]


def wind(sound: Sound, rate: int, rng: np.random.Generator) -> Sound:
    """Bursts of noise under 150 Hz, 10 dB over the take while they last; air alone."""
    low = signal.sosfilt(
        signal.butter(2, 150, fs=rate, output="sos"), rng.standard_normal(len(sound))
    )
    knots = np.arange(0, len(sound) / rate + 1, 0.4)
    gusts = np.interp(
        np.arange(len(sound)) / rate, knots, rng.uniform(-1, 1, len(knots)).clip(0)
    )
    air = AIR if sound.shape[1] > 1 else 0
    found = sound.copy()
    found[:, air] += low / _rms(low) * gusts * 3.2 * _rms(sound[:, air])
    return found


def gain_control(sound: Sound, rate: int, rng: np.random.Generator) -> Sound:
    """A phone's gain control: towards -20 dBFS, at most 30 dB up, down in 5 ms and up
    in 0.3 s; its noise comes up."""
    noisy = sound + rng.standard_normal(sound.shape) * 10 ** (-75 / 20)
    step = rate // 1000
    level = (
        np.sqrt(
            np.square(noisy[: len(noisy) // step * step])
            .reshape(-1, step, sound.shape[1])
            .mean(1)
        )
        + 1e-6
    )
    held = level.copy()
    for k in range(1, len(held)):
        held[k] += (held[k - 1] - held[k]) * np.where(
            held[k] > held[k - 1], np.exp(-1 / 5), np.exp(-1 / 300)
        )
    gain = np.minimum(0.1 / held, 10**1.5).repeat(step, axis=0)
    return np.clip(
        noisy * np.pad(gain, ((0, len(sound) - len(gain)), (0, 0)), "edge"), -1, 1
    )


def headset(sound: Sound, rate: int, rng: np.random.Generator) -> Sound:
    """A Bluetooth headset, as of mSBC: 16 kHz, 8 sub-bands, 26 bits for each 8 samples,
    shared out every 7.5 ms."""
    wide = _resampled(sound, rate, 16_000)
    places, bands = np.arange(16) + 4.5, np.arange(8)[:, None] + 0.5
    lapped = (
        0.5
        * np.sin(np.pi * (np.arange(16) + 0.5) / 16)
        * np.cos(np.pi / 8 * places * bands)
    )
    frames = -(-len(wide) // 120) + 1
    for channel in range(wide.shape[1]):
        padded = np.pad(wide[:, channel], (8, frames * 120 - len(wide)))
        values = (sliding_window_view(padded, 16)[::8] @ lapped.T)[
            : frames * 15
        ].reshape(frames, 15, 8)
        power = np.ceil(np.log2(np.abs(values).max(axis=1) + 1e-6))
        bits = np.zeros((frames, 8))
        for _ in range(26):
            bits[np.arange(frames), (power - bits).argmax(axis=1)] += 1
        step = (2 ** (power + 1) / np.maximum(2**bits - 1, 1))[:, None]
        values = (np.round(values / step) * step * (bits > 1)[:, None]).reshape(
            -1, 8
        ) @ lapped
        joined = values[:-1, 8:] + values[1:, :8]
        wide[:, channel] = joined.ravel()[: len(wide)]
    return _resampled(wide, 16_000, rate, len(sound))


def old_headset(sound: Sound, rate: int, rng: np.random.Generator) -> Sound:
    """The same of 2003: 300 to 3400 Hz, delta modulation of 64 kbit/s (CVSD) with
    Bluetooth's constants."""
    band = signal.butter(4, (300, 3400), "bandpass", fs=64_000, output="sos")
    fast = signal.sosfilt(band, _resampled(sound, rate, 64_000), axis=0)
    for channel in range(fast.shape[1]):
        gain = 3000 / (32_768 * _rms(fast[:, channel]))
        value, step, run, last, coded = 0.0, 10.0, 0, False, []
        for sample in (fast[:, channel] * gain * 32_768).tolist():
            up = sample >= value
            run, last = (run + 1 if up == last else 1), up
            step = min(step + 10, 1280) if run >= 4 else max(step * (1 - 1 / 1024), 10)
            value = min(
                max(value * (1 - 1 / 32) + (step if up else -step), -32_768), 32_767
            )
            coded.append(value)
        fast[:, channel] = np.array(coded) / (gain * 32_768)
    return _resampled(signal.sosfilt(band, fast, axis=0), 64_000, rate, len(sound))


def conference(sound: Sound, rate: int, rng: np.random.Generator) -> Sound:
    """Noise suppression of a conferencing app: in bands of 50 Hz, power less a floor
    that rises by 3 dB a second."""
    step = rate // 100
    *_, spectra = signal.stft(sound, rate, nperseg=2 * step, axis=0)
    power = signal.lfilter(
        [0.5], [1, -0.5], np.square(np.abs(spectra)) + 1e-14, axis=-1
    )
    floor = power.copy()
    floor[..., 0] = power[..., :10].mean(axis=-1)
    for k in range(1, power.shape[-1]):
        floor[..., k] = np.minimum(
            floor[..., k - 1] * 10**0.003, floor[..., k - 1] * 0.9 + power[..., k] * 0.1
        )
    gain = np.sqrt(np.maximum(1 - 2 * floor / power, 0.01))
    # Channels stand before frames.
    _, found = signal.istft(spectra * gain, rate, nperseg=2 * step, freq_axis=0)
    return np.asarray(found.T[: len(sound)])


def recorder(sound: Sound, rate: int, rng: np.random.Generator) -> Sound:
    """A cheap recorder: 8 bits up to each channel's peak, without dither."""
    step = (np.abs(sound).max(axis=0) + 1e-9) / 127
    return np.asarray(np.round(sound / step) * step)


def port(sound: Sound, rate: int, rng: np.random.Generator) -> Sound:
    """A MEMS microphone in a case under foam: resonance of 14 dB at 7 kHz and a fast
    fall over it; foam from 4 kHz."""
    foam = signal.butter(1, 4000, fs=rate, output="sos")
    fall = signal.butter(4, 7500, fs=rate, output="sos")
    found = signal.sosfilt(np.concatenate((foam, fall)), sound, axis=0)
    return np.asarray(
        found + 4 * signal.lfilter(*signal.iirpeak(7000, 5, rate), found, axis=0)
    )


def table(sound: Sound, rate: int, rng: np.random.Generator) -> Sound:
    """The table's reflection, 2 ms later and 3 dB under the sound; air alone."""
    air = AIR if sound.shape[1] > 1 else 0
    found = sound.copy()
    delay = round(0.002 * rate)
    found[delay:, air] += 10 ** (-3 / 20) * sound[:-delay, air]
    return found


def lost_packets(sound: Sound, rate: int, rng: np.random.Generator) -> Sound:
    """3 % of packets of 10 ms lost: the one before is repeated, and falls by half."""
    found, size = sound.copy(), rate // 100
    for at in range(size, len(sound) - size, size):
        if rng.random() < 0.03:
            found[at : at + size] = (
                found[at - size : at] * np.linspace(1, 0.5, size)[:, None]
            )
    return found


def supply(sound: Sound, rate: int, rng: np.random.Generator) -> Sound:
    """A switching supply: mains hum 6 dB under the take; a whine of 4 to 7 kHz, 15 dB
    under it, in step with the mains."""
    time = np.arange(len(sound)) / rate
    hum = sum(
        np.sin(2 * np.pi * 50 * k * time + rng.uniform(0, 6.3)) / k
        for k in range(1, 20, 2)
    )
    pitch = rng.uniform(4000, 7000) * (1 + 0.01 * np.sin(2 * np.pi * 0.3 * time))
    whine = np.sin(2 * np.pi * np.cumsum(pitch) / rate) * (
        1 + 0.5 * np.cos(2 * np.pi * 100 * time)
    )
    added = hum / _rms(hum) * 10 ** (-6 / 20) + whine / _rms(whine) * 10 ** (-15 / 20)
    return sound + added[:, None] * [_rms(channel) for channel in sound.T]


def _named(*channels: Distortion) -> dict[str, Distortion]:
    return {each.__name__.replace("_", " "): each for each in channels}


ROBOT_DB = -10.0
"""Level of the robot in dB relative to the take."""

MOTION = ("pencil_moveOnly.flac", 2.15, 5.44)
"""File of `gripper`, and the begin and end (s) of its movement in the air."""

AMBIENT = ("pencil_noise.flac", 0.0, 1.0)
"""File of `gripper`, and the begin and end (s) of a stretch in which its laser hears
nothing of the noise."""


def real_recordings(name: str) -> Path:
    """Return a folder of TACTOPHONE_RECORDINGS; ends the program where there is none,
    saying so."""
    root = os.environ.get("TACTOPHONE_RECORDINGS")
    if not root:
        sys.exit(
            "TACTOPHONE_RECORDINGS is not set: name a folder of real recordings that "
            f"holds `{name}`"
        )
    folder = Path(root, name)
    if not folder.is_dir():
        sys.exit(f"TACTOPHONE_RECORDINGS: {root} has no folder `{name}`")
    return folder


def _robot(
    sound: Sound, rate: int, rng: np.random.Generator, part: tuple[str, float, float]
) -> Sound:
    """Add a part of `gripper`, played to and fro from anywhere."""
    name, begin, end = part
    recorded, own = soundfile.read(real_recordings("gripper") / name, always_2d=True)
    once = _resampled(recorded[round(begin * own) : round(end * own)], own, rate)[:, 0]
    endless = np.tile(np.concatenate((once, once[::-1])), 2 + len(sound) // len(once))
    added = endless[rng.integers(2 * len(once)) :][: len(sound), None]
    found = sound.copy()  # `gripper` has a contact microphone alone
    found[:, :1] += added / _rms(added) * 10 ** (ROBOT_DB / 20) * _rms(sound[:, 0])
    return found


def motion(sound: Sound, rate: int, rng: np.random.Generator) -> Sound:
    """A gripper that moves in the air (Proesmans et al., ICRA 2025), 10 dB under the
    take."""
    return _robot(sound, rate, rng, MOTION)


def ambient(sound: Sound, rate: int, rng: np.random.Generator) -> Sound:
    """The loud noise around that gripper, 10 dB under the take."""
    return _robot(sound, rate, rng, AMBIENT)


DISTORTIONS = _named(
    telephone, mobile, opus, mp3, office, hall, clipped, motor, wind, gain_control
)

GROUPS: dict[str, dict[str, Distortion]] = {
    "ten": DISTORTIONS,
    "development": _named(headset, conference, port, lost_packets),
    "kept": _named(old_headset, recorder, table, supply),
    "robot": _named(motion, ambient),
}


def distorted(recording: Recording, name: str, folder: Path) -> Recording:
    """Write a recording as a channel leaves it; the same recording is always distorted
    alike."""
    path = (
        folder
        / name
        / f"{recording.surface}_{recording.path.parent.name}_{recording.path.stem}.wav"
    )
    if not path.exists():
        path.parent.mkdir(parents=True, exist_ok=True)
        sound, rate = soundfile.read(recording.path, always_2d=True)
        rng = np.random.default_rng(zlib.crc32(path.name.encode()))
        (channel,) = (group[name] for group in GROUPS.values() if name in group)
        soundfile.write(path, channel(sound, rate, rng), rate, subtype="FLOAT")
    return replace(recording, path=path)
