import numpy as np
import pytest

from tactophone.core.types import AudioBlock
from tactophone.signal.perception.health import FaultKind, Reference, SensorFault
from tactophone_lab.recording.quality import TakeLevels, TakeMeter, assess_take
from tactophone_lab.simulation.takes import TAKES

LIGHT, MEDIUM = TAKES[:2]
GOOD = TakeLevels(30.0, contact=0.6, clipped=0.0, level_dbfs=-15.0)


def complaints(levels: TakeLevels, others: dict[str, float] | None = None) -> str:
    return assess_take(MEDIUM, levels, others or {"long_light": -20.0}, duration=30.0)


def test_a_good_take_is_good() -> None:
    assert assess_take(MEDIUM, GOOD, {"long_light": -20.0}, duration=30.0) == "good"


@pytest.mark.parametrize(
    ("levels", "words"),
    [
        (TakeLevels(30.0, 0.02, 0.0, -15.0), "contact for only 2% of the time"),
        (TakeLevels(30.0, 0.6, 0.05, -15.0), "5.0% is clipped"),
        (TakeLevels(12.0, 0.6, 0.0, -15.0), "ends after 12.0 of 30 s"),
        (TakeLevels(30.0, 0.6, 0.0, -19.5), "not louder than light pressure (+0.5 dB)"),
        (
            TakeLevels(30.0, 0.6, 0.0, -15.0, (SensorFault(FaultKind.DEAD, 1),)),
            "air microphone dead",
        ),
    ],
)
def test_each_complaint_says_what_was_found(levels: TakeLevels, words: str) -> None:
    assert words in complaints(levels)


def test_pressure_is_compared_with_the_same_stroke_only() -> None:
    assert (
        assess_take(
            LIGHT, GOOD, {"long_medium": -10.0, "short_light": -10.0}, duration=30
        )
        == "good"
    )
    assert (
        assess_take(TAKES[-1], GOOD, {take.name: 0.0 for take in TAKES}, duration=30)
        == "good"
    )


def test_the_meter_measures_contact_level_and_clipping() -> None:
    rate = 48_000
    rng = np.random.default_rng(0)
    sound = rng.normal(0, 0.003, (4 * rate, 2))
    sound[2 * rate :] += rng.normal(0, 0.2, (2 * rate, 2))
    sound[-rate:, 0] = np.clip(8 * sound[-rate:, 0], -1, 1)
    meter = TakeMeter(rate, Reference())
    for start in range(0, len(sound), 509):
        meter.push(AudioBlock(sound[start : start + 509].astype(np.float32), rate))
    assert meter.levels.duration == pytest.approx(4.0)
    assert meter.levels.contact == pytest.approx(0.55, abs=0.1)
    assert meter.levels.clipped > 0.1
    assert [fault.code for fault in meter.levels.faults] == ["contact-clipped"]


def test_a_take_too_short_to_measure_has_no_contact() -> None:
    assert TakeMeter(48_000, Reference()).levels.contact == 0.0
