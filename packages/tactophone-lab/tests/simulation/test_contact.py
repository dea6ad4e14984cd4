"""Physics of the contact, through the finger that steps it."""

from dataclasses import replace

import numpy as np
import pytest

from tactophone.core.microphones import AIR, CONTACT
from tactophone_lab.simulation.catalogue import SimulatedObject, find
from tactophone_lab.simulation.finger import Electronics, Finger
from tactophone_lab.simulation.microphone_models import SessionVariation
from tactophone_lab.simulation.motion import five_stones, single
from tactophone_lab.simulation.source import SimulatedFinger
from tactophone_lab.simulation.takes import shuffled

PLACE = (0.04, 0.035)
QUIET = Electronics(
    contact_hum_dbfs=-200,
    contact_noise_dbfs=-200,
    contact_rumble_dbfs=-200,
    air_noise_dbfs=-200,
    room_dbfs=-200,
    motor_air_dbfs=-200,
    motor_contact_dbfs=-200,
)


def slide(
    obj: SimulatedObject,
    *,
    force: float = 1.0,
    speed: float = 0.08,
    finger: Finger = Finger(),  # noqa: B008
) -> np.ndarray:
    """Both channels of a second's steady sliding."""
    source = SimulatedFinger(
        single(replace(obj, length=0.3)),
        session=SessionVariation(finger, QUIET),
        place=PLACE,
    )
    source.move(*PLACE, force)
    for k in range(200):
        source.move(PLACE[0] + speed * k / 100, PLACE[1], force, time=0.3 + k / 100)
    source.render(24_000)
    return source.render(48_000).samples


def rms(samples: np.ndarray) -> np.ndarray:
    return samples.std(axis=0)


def test_faster_is_louder() -> None:
    assert np.all(rms(slide(find("3"), speed=0.12)) > rms(slide(find("3"), speed=0.03)))


def test_harder_is_louder() -> None:
    assert (
        rms(slide(find("3"), force=3.0))[CONTACT]
        > 1.5 * rms(slide(find("3"), force=0.5))[CONTACT]
    )


def test_rough_is_louder_in_air_for_as_much_in_contact() -> None:
    rough, smooth = rms(slide(find("0"))), rms(slide(find("3")))
    assert rough[AIR] / rough[CONTACT] > smooth[AIR] / smooth[CONTACT]


def test_friction_reaches_the_piezo_but_not_the_air() -> None:
    """Without the piezo's sensitivity to shear, the air signal is the same and the
    contact signal smaller."""
    insensitive = slide(find("3"), finger=Finger()._replace(shear_strain=0.0))
    whole = slide(find("3"))
    np.testing.assert_array_equal(insensitive[:, AIR], whole[:, AIR])
    assert rms(insensitive)[CONTACT] < 0.8 * rms(whole)[CONTACT]


def test_a_resting_finger_falls_silent() -> None:
    source = SimulatedFinger(
        single(find("0")), session=SessionVariation(electronics=QUIET), place=PLACE
    )
    source.move(*PLACE, 1.0)
    source.render(48_000)
    assert np.abs(source.render(4800).samples).max() < 1e-2
    assert source.truth.force.mean() == pytest.approx(1.0, rel=0.02)


def test_hovering_there_is_no_force() -> None:
    source = SimulatedFinger(
        single(find("0")), session=SessionVariation(electronics=QUIET), place=PLACE
    )
    source.render(9600)
    assert not source.truth.force.any()


@pytest.mark.slow
def test_a_body_that_was_left_comes_to_rest() -> None:
    """Else it rings on in numbers below 1e-308, which made a visit to five stones eight
    times slower to compute."""
    source = SimulatedFinger(five_stones(shuffled(1)), place=PLACE)
    source.move(*PLACE, 1.0)
    source.move(*PLACE, 1.0, time=0.5)
    source.move(*PLACE, -1.0, time=0.6)
    source.render(96_000 * 4)
    left = np.abs(
        np.concatenate(
            [
                source._ringing.displacement[:5].ravel(),
                source._ringing.speed[:5].ravel(),
            ]
        )
    )
    assert left.max() < 1e-12
    assert not ((left > 0) & (left < 1e-100)).any()
