"""The set-up of one recording session: finger, microphones and room vary a little from session to session."""

from dataclasses import dataclass, field
from typing import Self

import numpy as np

from tactophone.simulation.physics.finger import FLEXURE, Electronics, Finger
from tactophone.simulation.physics.modes import Mode
from tactophone.simulation.physics.tip import tip_named
from tactophone.types import DEFAULT_TIP


@dataclass(frozen=True, slots=True)
class SessionVariation:
    """What is constant within a session.

    Parameters
    ----------
    finger, electronics
        Mechanics and microphones.
    seed
        Draws the objects' modes and the phase of the hum.
    flexure
        Bending modes of what holds the tip.
    """

    finger: Finger = field(default_factory=Finger)
    electronics: Electronics = field(default_factory=Electronics)
    seed: int = 0
    flexure: tuple[Mode, ...] = FLEXURE

    @classmethod
    def of_tip(cls, tip: str, seed: int) -> Self:
        """Return the set-up as built for the default tip; for another, a session drawn with that seed."""
        return cls() if tip == DEFAULT_TIP else cls.draw(seed, tip=tip)

    @classmethod
    def draw(cls, seed: int, electronics: Electronics | None = None, *, tip: str = DEFAULT_TIP) -> Self:
        """Draw a session: gains vary by 1 dB (1 sigma), silicone by 10 %, microphone places by 15 to 25 %.

        ``electronics`` replaces those of the tip; ``tip`` is one of `~tactophone.simulation.physics.tip.TIPS`.
        """
        rng, tip_rng = np.random.default_rng([0x5E75, seed]), np.random.default_rng([0x71B, seed])
        chosen = tip_named(tip)
        finger = chosen.draw_finger(tip_rng)
        wired = chosen.draw_electronics(tip_rng, electronics)
        closeness = rng.uniform(0.85, 1.2)
        return cls(
            finger=finger._replace(
                pad_stiffness=finger.pad_stiffness * rng.uniform(0.9, 1.1),
                shear_stiffness=finger.shear_stiffness * rng.uniform(0.9, 1.1),
                normal_strain=finger.normal_strain * rng.uniform(0.8, 1.2),
                shear_strain=finger.shear_strain * rng.uniform(0.75, 1.25),
                pad_radiation=finger.pad_radiation * closeness,
                shear_radiation=finger.shear_radiation * closeness,
            ),
            electronics=wired._replace(
                contact_gain=wired.contact_gain * 10 ** (rng.normal(0, 1.0) / 20),
                air_gain=wired.air_gain * 10 ** (rng.normal(0, 1.0) / 20),
                contact_hum_dbfs=wired.contact_hum_dbfs + rng.normal(0, 0.5),
                room_dbfs=wired.room_dbfs + rng.normal(0, 2.5),
            ),
            seed=seed,
            flexure=chosen.flexure,
        )


COMPETITION = Electronics(room_dbfs=-48.0, motor_air_dbfs=-50.0, motor_contact_dbfs=-43.0)
"""A hall full of people, and running motors."""
