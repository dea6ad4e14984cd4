"""What a fingertip with two microphones makes of sound that comes through the air:
speech, music, drums, noise, rain, a keyboard, claps.

    python benchmarks/airborne.py [MODEL ...] [--seconds 20] [--sound FILE ...]

The pairs are MADE: nobody has recorded a contact microphone and an air microphone
together. Air is the sound, its loudest second at -20 dBFS, over a room's noise of
-65 dBFS. Contact is the same sound through an assumed coupling (`COUPLINGS`), over
noise of -75 dBFS, which is quieter than any that was simulated: it hides nothing. A
second of both noises comes first. Printed are the share of the time with contact, the
share rendered rough, and the onsets of contact in a minute, through the live pipeline.
``--sound`` adds recordings of others, such as real speech.
"""

import argparse
from collections.abc import Callable, Iterator, Mapping, Sequence
from pathlib import Path
from types import MappingProxyType

import numpy as np
import soundfile
from scipy import signal

from no_touch import RATE, Floats, sounds
from no_touch_sounds import over_noise
from tactophone.core.types import AudioBlock, FloatArray, Touch
from tactophone.signal.pipeline import open_pipeline

PACKET = 480
CONTACT_NOISE_DBFS = -75.0
LEAD = 1.0
"""Seconds of noise before the sound."""


def attenuated(sound: Floats, db: float) -> Floats:
    """Return a sound that is so many dB quieter."""
    return np.asarray(sound * 10 ** (-db / 20), np.float64)


def dull(sound: Floats) -> Floats:
    """Return a sound 20 dB quieter, and without what is over 800 Hz."""
    low = signal.butter(2, 800, "low", fs=RATE, output="sos")
    return attenuated(signal.sosfilt(low, sound), 20)


def resonant(sound: Floats) -> Floats:
    """Return what a bare disc hears: 20 dB quieter where it resonates, and less
    elsewhere, by a way of its own through hand and room."""
    rng = np.random.default_rng(8)
    time = np.arange(round(0.02 * RATE)) / RATE
    way = rng.standard_normal(len(time)) * np.exp(-time / 0.003)
    way /= np.abs(np.fft.rfft(way)).max()
    return attenuated(signal.fftconvolve(sound, way)[: len(sound)], 20)


COUPLINGS: Mapping[str, Callable[[Floats], Floats]] = MappingProxyType(
    {
        "-20 dB under 800 Hz": dull,
        "-20 dB, resonant": resonant,
        "-40 dB, resonant": lambda sound: attenuated(resonant(sound), 20),
    }
)
"""What the contact microphone hears of a sound in the air. Under a pad the pressure
alone gives -67 dB; 20 dB are for a disc in the open (`signal.perception.airborne`)."""


def drums(seconds: float) -> Floats:
    """Return a bar of kick, snare and hi-hat, over and over, at 110 beats a minute."""
    rng = np.random.default_rng(5)
    beat = round(60 / 110 * RATE)
    time = np.arange(beat) / RATE
    noise = rng.standard_normal(beat)
    bright = signal.butter(2, 5000, "high", fs=RATE, output="sos")
    kick = np.sin(2 * np.pi * (50 * time - 6 * np.exp(-time / 0.02))) * np.exp(
        -time / 0.12
    )
    snare = (0.6 * noise + 0.5 * np.sin(2 * np.pi * 190 * time)) * np.exp(-time / 0.07)
    hat = 0.3 * signal.sosfilt(bright, noise) * np.exp(-time / 0.03)
    half = np.roll(hat, beat // 2)
    bar = np.concatenate((kick + hat, snare + half, kick + half, snare + hat))
    return np.resize(bar, int(seconds * RATE))


def plucked(seconds: float) -> Floats:
    """Return plucked strings, two notes a second (Karplus and Strong, Computer Music J.
    7, 43, 1983)."""
    rng = np.random.default_rng(6)
    found = np.zeros(int(seconds * RATE))
    for start in range(0, len(found) - RATE, RATE // 2):
        period = round(RATE / rng.choice([110.0, 147.0, 196.0, 247.0, 330.0]))
        excited = np.zeros(RATE)
        excited[:period] = rng.standard_normal(period)
        # Each period is the mean of neighbours of the one before.
        ring = np.zeros(period + 2)
        ring[0], ring[-2], ring[-1] = 1, -0.498, -0.498
        found[start : start + RATE] += signal.lfilter([1], ring, excited)
    return found


def bursts(seconds: float) -> Floats:
    """Return white noise that comes and goes each half second."""
    noise = np.random.default_rng(7).standard_normal(int(seconds * RATE))
    return noise * (np.arange(len(noise)) // (RATE // 2) % 2)


def airborne_sounds(
    seconds: float, files: Sequence[Path] = ()
) -> Iterator[tuple[str, Floats]]:
    """Yield each sound with its name; speech by espeak-ng where that is installed."""
    yield from sounds(seconds)
    music = drums(seconds)
    yield "drums", music
    yield "plucked strings", plucked(seconds)
    yield "drums and strings", music + 0.7 * plucked(seconds)
    yield "noise in bursts", bursts(seconds)
    for file in files:
        samples, rate = soundfile.read(file, always_2d=True)
        sound = signal.resample_poly(samples[:, 0], RATE, rate)
        yield file.stem, sound[: int(seconds * RATE)]


def made_pair(sound: Floats, coupling: Callable[[Floats], Floats]) -> FloatArray:
    """Return contact and air, ``(samples, 2)``, of a sound in the air."""
    rng = np.random.default_rng(0)
    lead = np.zeros(int(LEAD * RATE))
    air = over_noise(np.append(lead, sound), RATE, rng).astype(np.float64)[:, 0]
    # The room's noise comes with the sound: its coupling is as good.
    own = 10 ** (CONTACT_NOISE_DBFS / 20) * rng.standard_normal(len(air))
    contact = coupling(air) + own
    return np.column_stack((contact, air)).astype(np.float32)


def felt(pair: FloatArray, model: str) -> tuple[float, float, float]:
    """Return the shares of contact and of rough from the sound's beginning on, and
    onsets of contact a minute."""
    pipeline = open_pipeline(model, sample_rate=RATE, channels=2)
    touches = []
    newest = Touch.NONE
    for start in range(0, len(pair) - PACKET, PACKET):
        step = pipeline.push(AudioBlock(pair[start : start + PACKET], RATE, start))
        here = [each.touch for each in step.predictions]
        newest = here[-1] if here else newest
        # Of several answers in a packet the strongest counts.
        touches.append(max([newest, *here], key=lambda touch: touch.value))
    told = np.array([touch.value for touch in touches[int(LEAD * RATE / PACKET) :]])
    contact = told != Touch.NONE.value
    onsets = int((np.diff(contact.astype(int), prepend=0) > 0).sum())
    minutes = len(told) * PACKET / RATE / 60
    return (
        float(contact.mean()),
        float((told == Touch.ROUGH.value).mean()),
        onsets / minutes,
    )


def main() -> None:
    """Print the table."""
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "models",
        nargs="*",
        default=["texture"],
        metavar="MODEL",
        help="default: texture",
    )
    parser.add_argument(
        "--seconds", type=float, default=20.0, help="of each sound (default: 20)"
    )
    parser.add_argument(
        "--sound",
        type=Path,
        nargs="+",
        default=[],
        metavar="FILE",
        help="recordings to hear too",
    )
    args = parser.parse_args()
    print(
        "MADE pairs; contact and rough are shares of the time.\n\n| model | sound "
        "| contact microphone hears it | contact | rough | onsets of contact a minute |"
        "\n|---|---|---|--:|--:|--:|"
    )
    for name, sound in airborne_sounds(args.seconds, args.sound):
        for coupling, couple in COUPLINGS.items():
            pair = made_pair(sound, couple)
            for model in args.models:
                contact, rough, onsets = felt(pair, model)
                print(
                    f"| {model} | {name} | {coupling} | {contact:.3f} | {rough:.3f} | "
                    f"{onsets:.0f} |",
                    flush=True,
                )


if __name__ == "__main__":
    main()
