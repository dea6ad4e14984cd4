"""Predictions in 16 bytes."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tactophone.core.errors import PacketError
from tactophone.core.types import Prediction, Touch
from tactophone.net.link.packet import read_prediction, write_prediction

shares = st.floats(0, 1)


@pytest.mark.slow
@given(
    shares,
    shares,
    shares,
    st.sampled_from(Touch),
    st.floats(-120, 0),
    st.floats(0, 1),
    st.booleans(),
    st.booleans(),
)
def test_a_prediction_survives_the_wire(
    smooth: float,
    rough: float,
    roughness: float,
    touch: Touch,
    level: float,
    length: float,
    faulty: bool,
    unknown: bool,
) -> None:
    none = max(0.001, 1 - smooth - rough)
    total = none + smooth + rough
    sent = Prediction(
        (none / total, smooth / total, rough / total),
        touch,
        roughness,
        level,
        5 - length,
        5.0,
        faulty,
        unknown=unknown,
    )
    content = write_prediction(sent)
    assert len(content) == 16
    got = read_prediction(content, end=5.0)
    assert got.probabilities == pytest.approx(sent.probabilities, abs=1e-4)
    assert sum(got.probabilities) == pytest.approx(1)
    assert (got.touch, got.end) == (touch, 5.0)
    assert (got.faulty, got.unknown) == (faulty, unknown)
    assert got.roughness == pytest.approx(roughness, abs=1e-4)
    assert got.level_dbfs == pytest.approx(level, abs=0.01)
    assert got.start == pytest.approx(5 - length, abs=1e-4)


def test_silence_is_minus_infinity() -> None:
    content = write_prediction(
        Prediction((1.0, 0.0, 0.0), Touch.NONE, 0.0, -math.inf, 0.0, 1.0)
    )
    assert read_prediction(content, end=1.0).level_dbfs == -math.inf


@pytest.mark.parametrize("wrong", [math.nan, math.inf])
def test_non_finite_values_arrive_as_a_fault(wrong: float) -> None:
    content = write_prediction(
        Prediction((wrong, 0.0, 0.0), Touch.ROUGH, wrong, wrong, 0.0, 1.0)
    )
    assert read_prediction(content, end=1.0).faulty


@pytest.mark.parametrize(
    "content", [b"", bytes(15), bytes(17), bytes(16), b"\x03" + b"\x01" * 15]
)
def test_invalid_bytes_are_refused(content: bytes) -> None:
    with pytest.raises(PacketError):
        read_prediction(content, end=0.0)
