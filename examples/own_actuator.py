"""Your own actuator: python examples/own_actuator.py

In a package, `[project.entry-points."tactophone.actuators"]` with `mine =
"package:make"` lets `tactophone receive --actuator mine:DEVICE` find it. Every period,
`render` fills one array for each finger: your driver plays it.
"""

import numpy as np

from tactophone import LIVE_SAMPLE_RATE, HapticCommand, Oscillator
from tactophone.live.audio.actuator import Actuator, ClockedDevice, RenderHand


def make(*, render: RenderHand, fingers: int, device: str) -> Actuator:
    """Return an actuator that prints a bar for each period of 10 ms; replace `play` by
    a call of your driver."""

    def play(inputs: list[np.ndarray], outputs: list[np.ndarray]) -> None:
        render(outputs)
        print(*(f"{'#' * round(40 * float(np.abs(out).max())):40}" for out in outputs))

    period = LIVE_SAMPLE_RATE // 100
    return Actuator(ClockedDevice(play, period=period, outputs=fingers))


if __name__ == "__main__":
    import time

    oscillator = Oscillator()
    with make(render=lambda outs: oscillator.render(outs[0]), fingers=1, device=""):
        for number in range(50):
            oscillator.submit(HapticCommand(number / 100, 80.0, number / 100))
            time.sleep(0.01)
