"""Sounds that are no touch, for training: a voice, rain, a keyboard, claps.

An air microphone hears them as well as the finger. They are simple on purpose: a
source, a few resonances and an envelope, drawn anew for each sound;
``benchmarks/no_touch.py`` scores on others.
"""

from collections.abc import Callable, Mapping
from types import MappingProxyType

import numpy as np
from numpy.typing import NDArray
from scipy import signal

NO_TOUCH_RATE = 16_000
"""Sample rate in Hz."""

LEAD_SECONDS = 0.5
"""Silence before a sound, in s."""

NOISE_DBFS = -65.0
"""Level of the room's noise under silence and sound, in dBFS."""

Floats = NDArray[np.float64]


def _resonance(sound: Floats, frequency: float, width: float) -> Floats:
    return np.asarray(
        signal.lfilter(
            *signal.iirpeak(frequency, frequency / width, NO_TOUCH_RATE), sound
        )
    )


def _strewn(size: int, places: Floats, burst: Callable[[], Floats]) -> Floats:
    """Add a burst at each place in s."""
    found = np.zeros(size)
    for at in (places * NO_TOUCH_RATE).astype(int):
        new = burst()[: max(0, size - at)]
        found[at : at + len(new)] += new
    return found


def _decaying(
    rng: np.random.Generator, seconds: float, frequency: float, width: float
) -> Floats:
    """Return noise that decays to 1/e within some seconds, around a frequency."""
    time = np.arange(int(6 * seconds * NO_TOUCH_RATE) + 8) / NO_TOUCH_RATE
    noise = np.append(
        rng.standard_normal(len(time)) * np.exp(-time / seconds), np.zeros(160)
    )
    return 0.2 * noise + _resonance(noise, frequency, width)


def voice(seconds: float, rng: np.random.Generator) -> Floats:
    """Return syllables of a harmonic voice through moving formants, with hissing and
    popping consonants."""
    size = int(seconds * NO_TOUCH_RATE)
    found, at, pitch = np.zeros(size), 0.0, rng.uniform(90, 230)
    while at < seconds:
        length = rng.uniform(0.08, 0.3)
        time = np.arange(int(length * NO_TOUCH_RATE)) / NO_TOUCH_RATE
        phase = (
            np.cumsum(
                pitch
                * rng.uniform(0.8, 1.25)
                * (1 + rng.uniform(-0.3, 0.3) * time / length)
            )
            / NO_TOUCH_RATE
        )
        source = np.diff(
            signal.sawtooth(2 * np.pi * phase), prepend=0
        ) + 0.02 * rng.standard_normal(len(time))
        formants = [
            (rng.uniform(250, 900), 90),
            (rng.uniform(800, 2400), 120),
            (rng.uniform(2200, 3500), 200),
        ]
        vowel = np.asarray(
            sum(_resonance(source, *each) / (n + 1) for n, each in enumerate(formants))
        )
        vowel *= np.sin(np.pi * np.minimum(time / length, 1)) ** rng.uniform(0.3, 1)
        hiss = _decaying(
            rng,
            rng.uniform(0.005, 0.06),
            rng.uniform(2500, 7000),
            rng.uniform(800, 4000),
        )
        for sound, place, weight in (
            (vowel, at + 0.04, 1.0),
            (hiss, at, rng.uniform(0, 0.3)),
        ):
            begin = int(place * NO_TOUCH_RATE)
            part = sound[: max(0, size - begin)]
            found[begin : begin + len(part)] += (
                weight * part / (np.abs(sound).max() + 1e-9)
            )
        at += length + (
            rng.uniform(0.2, 0.7) if rng.random() < 0.15 else rng.uniform(0, 0.12)
        )
    return found


def rain(seconds: float, rng: np.random.Generator) -> Floats:
    """Return drops on a thing of a few resonances, over the hiss of those further
    away."""
    size, rate = (
        int(seconds * NO_TOUCH_RATE),
        np.exp(rng.uniform(np.log(15), np.log(250))),
    )
    tones, width = rng.uniform(400, 6000, 4), rng.uniform(200, 2000)
    places = np.sort(rng.uniform(0, seconds, rng.poisson(rate * seconds)))
    drops = _strewn(
        size,
        places,
        lambda: (
            rng.lognormal(0, 0.8)
            * _decaying(rng, rng.uniform(4e-4, 4e-3), float(rng.choice(tones)), width)
        ),
    )
    return drops + rng.uniform(0, 0.3) * drops.std() * rng.standard_normal(size)


def keyboard(seconds: float, rng: np.random.Generator) -> Floats:
    """Return keys that are pressed and released."""
    presses = np.cumsum(rng.gamma(2, rng.uniform(0.05, 0.2), int(seconds * 20)))
    places = np.concatenate((presses, presses + rng.uniform(0.05, 0.12, len(presses))))
    low, high = rng.uniform(150, 600), rng.uniform(1200, 6000)

    def click() -> Floats:
        seconds = rng.uniform(0.001, 0.012)
        found = rng.lognormal(0, 0.5) * _decaying(
            rng, seconds, high * rng.uniform(0.8, 1.25), 800
        )
        return found + rng.uniform(0, 1) * _decaying(rng, seconds, low, 200)

    return _strewn(int(seconds * NO_TOUCH_RATE), places[places < seconds], click)


def claps(seconds: float, rng: np.random.Generator) -> Floats:
    """Return claps of hands in a room."""
    places = np.cumsum(rng.gamma(6, rng.uniform(0.02, 0.1), int(seconds * 10)))
    tone, room, tail = (
        rng.uniform(600, 2500),
        rng.uniform(0.02, 0.15),
        rng.uniform(0.05, 0.5),
    )

    def clap() -> Floats:
        direct = _decaying(
            rng, rng.uniform(0.001, 0.008), tone * rng.uniform(0.8, 1.25), 900
        )
        late = tail * _decaying(rng, room, tone, 1500)
        late[: len(direct)] += direct[: len(late)]
        return rng.lognormal(0, 0.4) * late

    return _strewn(int(seconds * NO_TOUCH_RATE), places[places < seconds], clap)


SOUNDS: Mapping[str, Callable[[float, np.random.Generator], Floats]] = MappingProxyType(
    {"voice": voice, "rain": rain, "keyboard": keyboard, "claps": claps}
)


def draw_no_touch(
    name: str, seconds: float, seed: int, *, lead: float = LEAD_SECONDS
) -> NDArray[np.float32]:
    """Return a sound of `SOUNDS` after a lead of silence, over noise, ``(samples,
    1)``."""
    rng = np.random.default_rng([seed, *name.encode()])
    sound = np.append(np.zeros(int(lead * NO_TOUCH_RATE)), SOUNDS[name](seconds, rng))
    return over_noise(sound, NO_TOUCH_RATE, rng)


def over_noise(
    sound: Floats, rate: int, rng: np.random.Generator
) -> NDArray[np.float32]:
    """Bring the loudest second of a sound to -20 dBFS, and add the noise of a room."""
    power = (
        np.convolve(np.square(sound), np.ones(rate) / rate, "valid")
        if len(sound) < 3 * rate
        else (
            np.square(sound[: len(sound) // rate * rate]).reshape(-1, rate).mean(axis=1)
        )
    )
    levelled = 0.1 * sound / np.sqrt(power.max() + 1e-18)
    noise = 10 ** (NOISE_DBFS / 20) * rng.standard_normal(len(sound))
    return np.clip(levelled + noise, -1, 1).astype(np.float32)[:, None]
