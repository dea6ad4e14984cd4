"""Drive an actuator by hand: python examples/drive_oscillator.py vibration.wav

Renders one second of the paper's *rough* (60 Hz), then silence, into a WAV file. The
limits bound the amplitude at every sample; without a new command every 35 ms the
vibration fades to silence, as when a robot stops sending.
"""

import sys

import numpy as np
import soundfile

from tactophone import HapticCommand, Limits, Oscillator

SAMPLE_RATE = 48_000
PERIOD = 480  # samples that a sound card asks for at once: 10 ms


def main(path: str) -> None:
    """Render 1.5 s; commands come during the first second."""
    oscillator = Oscillator(Limits(ceiling=0.3), sample_rate=SAMPLE_RATE)
    periods = []
    for number in range(150):
        if number < 100:
            oscillator.submit(
                HapticCommand(
                    amplitude=1.0, frequency=60.0, time=number * PERIOD / SAMPLE_RATE
                )
            )
        out = np.zeros(PERIOD, np.float32)
        oscillator.render(out)
        periods.append(out)
    soundfile.write(path, np.concatenate(periods), SAMPLE_RATE, subtype="FLOAT")


if __name__ == "__main__":
    main(*sys.argv[1:])
