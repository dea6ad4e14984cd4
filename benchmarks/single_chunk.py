"""How long must *rough* last, in the middle of *smooth*, to be felt: by actuator.

    python benchmarks/single_chunk.py

The paper's two stimuli, with the oscillator's low-pass of 4 ms, through an actuator
whose amplitude follows in one time constant: 2 ms, a voice coil over its band; 25 ms, a
linear resonant actuator (Q of 13 at 170 Hz); 60 ms, a rotating mass (50 ms and more to
change is usual). It is felt if a percept of the simulated operator, one each 30 ms,
differs from every percept of *smooth* by three just-noticeable steps: of level 1.5 dB,
of pitch 18 %. The worst of eight phases counts.
"""

import argparse

import numpy as np

from simulated_operator import perceive
from tactophone.signal.haptics.psychophysics import LEVEL_JND_DB, PITCH_JND

RATE = 8000
"""Sample rate of the vibration in Hz."""

CHUNK = 512 / 48_000
"""Seconds between two predictions: 512 samples at 48 kHz."""

STEPS = 3
"""Just-noticeable steps from which a difference counts as felt."""

LOW_PASS = 4e-3
"""Time constant in s of the oscillator's low-pass."""

ACTUATORS = {"voice coil": 2e-3, "linear resonant": 25e-3, "rotating mass": 60e-3}
"""Time constant in s with which each actuator's amplitude follows."""


def vibration(chunks: int, constant: float, start: float) -> np.ndarray:
    """Return smooth for 1.2 s, in which rough lasts for a number of chunks from
    ``start`` on."""
    time = np.arange(round(1.2 * RATE)) / RATE
    rough = ((time >= start) & (time < start + chunks * CHUNK)).astype(float)
    heard = [
        _followed(target, LOW_PASS)
        for target in (rough, 10 ** (-25 * (1 - rough) / 20))
    ]
    frequency = 120 * 2 ** -heard[0]
    return np.sin(2 * np.pi * np.cumsum(frequency) / RATE) * _followed(
        heard[1], constant
    )


def _followed(target: np.ndarray, constant: float) -> np.ndarray:
    share, out = 1 - np.exp(-1 / (constant * RATE)), np.empty_like(target)
    value = target[0]
    for i, goal in enumerate(target):
        value += share * (goal - value)
        out[i] = value
    return out


def felt(chunks: int, constant: float) -> bool:
    """Return whether it is felt whenever it begins."""
    before = perceive(vibration(0, constant, 0.6), RATE)
    level, pitch = (np.median(values[5:]) for values in (before.level_db, before.pitch))
    for start in 0.6 + np.arange(8) / 8 * 0.03:
        found = perceive(vibration(chunks, constant, start), RATE)
        louder = np.abs(found.level_db[5:] - level).max() >= STEPS * LEVEL_JND_DB
        lower = np.abs(found.pitch[5:] - pitch).max() >= STEPS * np.log1p(PITCH_JND)
        if not (louder or lower):
            return False
    return True


def main() -> None:
    argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    ).parse_args()
    print("| actuator | chunks of 10.7 ms until felt | ms |\n|---|--:|--:|")
    for name, constant in ACTUATORS.items():
        least = next((chunks for chunks in range(1, 60) if felt(chunks, constant)), 60)
        print(f"| {name} | {least} | {1e3 * least * CHUNK:.0f} |")


if __name__ == "__main__":
    main()
