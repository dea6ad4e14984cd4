import numpy as np
import pytest

from tactophone_lab.simulation.contact import ContactSignals
from tactophone_lab.simulation.finger import Electronics
from tactophone_lab.simulation.microphone_models import (
    NORMALS,
    Microphones,
    cavity_sections,
)
from tactophone_lab.simulation.modes import Mounting

RATE = 48_000
QUIET = Electronics(
    contact_hum_dbfs=-200,
    contact_noise_dbfs=-200,
    contact_rumble_dbfs=-200,
    air_noise_dbfs=-200,
    room_dbfs=-200,
    motor_air_dbfs=-200,
    motor_contact_dbfs=-200,
)


def convert(
    strain: np.ndarray,
    pressure: np.ndarray,
    electronics: Electronics,
    motor: float | np.ndarray = 0.0,
) -> np.ndarray:
    microphones = Microphones(
        electronics, Mounting.TABLE, seed=np.random.SeedSequence(1), rate=RATE
    )
    signals = ContactSignals(
        strain, np.zeros_like(strain), pressure, np.zeros_like(strain)
    )
    normals = np.random.default_rng(0).standard_normal((strain.size, NORMALS))
    return microphones.convert(
        signals, np.broadcast_to(motor, strain.size).astype(float), normals
    )


def tone(frequency: float, amplitude: float) -> np.ndarray:
    return amplitude * np.sin(2 * np.pi * frequency * np.arange(RATE) / RATE)


def test_newtons_and_pascals_become_full_scale() -> None:
    out = convert(tone(400, 0.1), tone(400, 0.1), QUIET)[RATE // 2 :]
    assert np.abs(out[:, 0]).max() == pytest.approx(0.1 * QUIET.contact_gain, rel=0.02)
    assert np.abs(out[:, 1]).max() == pytest.approx(0.1 * QUIET.air_gain, rel=0.02)


def test_frequencies_under_the_corner_are_attenuated() -> None:
    out = convert(
        tone(QUIET.contact_corner / 4, 0.1), tone(QUIET.air_corner / 4, 0.1), QUIET
    )[RATE // 2 :]
    assert np.abs(out[:, 0]).max() < 0.1 * QUIET.contact_gain / 10
    assert np.abs(out[:, 1]).max() < 0.1 * QUIET.air_gain / 10


def test_the_preamplifier_clips() -> None:
    out = convert(tone(400, 100.0), tone(400, 100.0), QUIET)
    assert out.min() == -1.0
    assert 0.999 < out.max() < 1.0


def test_noise_floors_have_their_levels() -> None:
    still = np.zeros(RATE)
    level = 20 * np.log10(convert(still, still, Electronics()).std(axis=0))
    assert level == pytest.approx([-30.1, -59.0], abs=1.0)


def test_motors_are_in_both_channels() -> None:
    still = np.zeros(RATE)
    loud = QUIET._replace(motor_air_dbfs=-40, motor_contact_dbfs=-40)
    assert np.all(
        convert(still, still, loud, motor=1.0).std(axis=0)
        > 100 * convert(still, still, loud).std(axis=0)
    )


def test_only_boxes_resonate() -> None:
    rng = np.random.default_rng(0)
    assert len(cavity_sections(Mounting.BOX, rng, RATE)) == 3
    assert len(cavity_sections(Mounting.HELD, rng, RATE)) == 0


def test_gears_are_heard_while_motors_run_and_jerks_only_at_starts_and_stops() -> None:
    still, time = np.zeros(RATE), np.arange(RATE) / RATE
    # Runs from 0.2 to 0.7 s, and turns at 0.45 s within 20 ms.
    runs = ((time >= 0.2) & (time < 0.7) & (np.abs(time - 0.45) > 0.01)).astype(float)
    gears, jerks = (
        convert(still, still, QUIET._replace(**{name: -20.0}), motor=runs)[:, 0]
        for name in ("gear_dbfs", "jerk_dbfs")
    )

    def level(sound: np.ndarray, begin: float) -> float:
        return float(
            20
            * np.log10(
                sound[round(begin * RATE) : round((begin + 0.05) * RATE)].std() + 1e-9
            )
        )

    assert level(gears, 0.1) < -100
    assert level(gears, 0.3) == pytest.approx(-20, abs=2)
    assert level(jerks, 0.1) < -100
    assert [level(jerks, begin) for begin in (0.2, 0.75)] == pytest.approx(
        [-22, -22], abs=3
    )
    assert level(jerks, 0.65) < level(jerks, 0.47) < level(jerks, 0.3) < -25
