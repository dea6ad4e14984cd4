"""The paper's cue in simulated sound: air over contact microphone while the finger touches, rough against smooth.

Objects 0 to 19, three takes of 6 s, without noise. Each line takes the air microphone's sensitivity to being shaken by
the finger that carries it at another value; the default is the first.

python benchmarks/air_to_contact.py
"""

from dataclasses import replace

import numpy as np
from numpy.typing import NDArray
from scipy import signal

from tactophone.core.types import Touch
from tactophone.lab.simulation.catalogue import catalogue
from tactophone.lab.simulation.contact import ContactSignals
from tactophone.lab.simulation.finger import Finger
from tactophone.lab.simulation.microphones import SessionVariation
from tactophone.lab.simulation.motion import single
from tactophone.lab.simulation.source import SimulatedFinger
from tactophone.lab.simulation.strokes import take_moves
from tactophone.lab.simulation.takes import TAKES

RATE, SECONDS = 48_000, 6.0
BANDS = ((20, 1000), (60, 300), (125, 1000), (300, 1000), (1000, 8000))
"""Hz; the paper's network hears up to 1000."""

SHAKEN = (Finger().shake_radiation, Finger().shake_radiation / 3, 0.0)
"""Pa per m/s^2."""


def touches(number: int, take: int, shaken: float) -> tuple[ContactSignals, SessionVariation]:
    """Return forces and pressures of a take, and the session whose microphones hear them."""
    session = SessionVariation.draw(number)
    session = replace(session, finger=session.finger._replace(shake_radiation=shaken))
    scene = single(catalogue()[number])
    moves = take_moves(TAKES[take], scene.placed[0], duration=SECONDS, rng=np.random.default_rng([number, take]))
    finger = SimulatedFinger(scene, moves, session=session, seed=take, place=scene.placed[0].centre)
    return finger.touch(round(SECONDS * RATE)).signals, session


def powers(sound: NDArray[np.float64], corner: float, touching: NDArray[np.bool_]) -> NDArray[np.float64]:
    """Return the power in each band while touching, after the microphone's high-pass."""
    sound = signal.sosfilt(signal.butter(2, corner, "high", fs=RATE, output="sos"), sound)
    filters = (signal.butter(4, band, "band", fs=RATE, output="sos") for band in BANDS)
    return np.array([np.mean(signal.sosfiltfilt(each, sound)[touching] ** 2) for each in filters])


def ratio_db(number: int, shaken: float) -> NDArray[np.float64]:
    """Return air over contact of an object in each band, over a long, a short and a wiggle take of medium pressure."""
    air, contact = np.zeros(len(BANDS)), np.zeros(len(BANDS))
    for take in (1, 4, 6):
        signals, session = touches(number, take, shaken)
        touching, wired = signals.force > 0, session.electronics
        air += wired.air_gain**2 * powers(signals.finger + signals.body, wired.air_corner, touching)
        contact += wired.contact_gain**2 * powers(signals.strain, wired.contact_corner, touching)
    return np.asarray(10 * np.log10(air / contact))


def main() -> None:
    print("| air microphone shaken, Pa per m/s^2 | object | " + " | ".join(f"{a}-{b} Hz" for a, b in BANDS) + " |")
    print("|--:|---|" + "--:|" * len(BANDS))
    objects = [obj for obj in catalogue() if obj.number < 20]
    for shaken in SHAKEN:
        levels = {obj.number: ratio_db(obj.number, shaken) for obj in objects}
        rough, smooth = (
            np.mean([levels[obj.number] for obj in objects if obj.label is touch], axis=0)
            for touch in (Touch.ROUGH, Touch.SMOOTH)
        )
        for name, row in (("rough", rough), ("smooth", smooth), ("the cue", rough - smooth)):
            print(f"| {shaken:g} | {name} | " + " | ".join(f"{value:.1f}" for value in row) + " |")


if __name__ == "__main__":
    main()
