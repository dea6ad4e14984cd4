"""Predictions as vibration in the RTP payload for haptics (RFC 9993)."""

import math

import pytest
from hypothesis import given
from hypothesis import strategies as st

from tactophone.errors import PacketError
from tactophone.haptics.mapping import ROUGH_STIMULUS, SMOOTH_STIMULUS
from tactophone.link import BlockEncoder, Codec, Redundancy, RedundancyRule
from tactophone.link.haptic_payload import (
    ROUGH_HZ,
    SMOOTH_DBFS,
    SMOOTH_HZ,
    is_silent,
    read_haptics,
    read_vibration,
    write_haptics,
)
from tactophone.link.packet import PayloadType, parse_packet
from tactophone.link.packetizer import Packetizer
from tactophone.types import Prediction, Touch


def prediction(touch: Touch, roughness: float, *, faulty: bool = False) -> Prediction:
    none = float(touch is Touch.NONE)
    shares = (none, (1 - none) * (1 - roughness), (1 - none) * roughness)
    return Prediction(shares, touch, roughness, -20.0, 0.0, 0.256, faulty)


GOLDEN = {
    # D 0, UT 2, L 0 | unit: type 1, sync 0, layer 0, 512 samples, 25 bytes | data packet (5) of 22 bytes
    # | one effect, number 24 (the 24th interval), at position 0 | one keyframe: 255 of 255, at 0, 60 Hz.
    "rough": (
        prediction(Touch.ROUGH, 1.0),
        "20  04 00 00 20 00 00 00 01 90  14 00 2c  00 00 00 00 00 00 80 0c 00 00 00 00 00 08  00 00 7f e0 00 00 07 80",
    ),
    "silent": (prediction(Touch.NONE, 0.0), "40  0c 00 00 20 00 00 00 00 00"),
}
"""Computed by hand from the table in `docs/reference/wire-format.md`."""


@given(st.floats(0, 1))
def test_touch_and_roughness_survive_the_wire(roughness: float) -> None:
    touch = Touch.ROUGH if roughness >= 0.5 else Touch.SMOOTH
    got = read_haptics(write_haptics(prediction(touch, roughness)), end=0.256)
    # Whole Hz: half of one is 0.012 of the scale at its rough end.
    assert got.roughness == pytest.approx(roughness, abs=0.0125)
    assert got.touch is touch or abs(roughness - 0.5) < 0.0125
    assert got.probabilities == pytest.approx((0, 1 - got.roughness, got.roughness))
    assert (got.level_dbfs, got.end) == (-math.inf, 0.256)


def test_the_vibration_is_the_papers() -> None:
    assert (SMOOTH_STIMULUS.frequency, SMOOTH_STIMULUS.level_dbfs) == (SMOOTH_HZ, SMOOTH_DBFS)
    assert (ROUGH_STIMULUS.frequency, ROUGH_STIMULUS.level_dbfs) == (ROUGH_HZ, 0.0)
    rough = read_vibration(write_haptics(prediction(Touch.ROUGH, 1.0)))
    smooth = read_vibration(write_haptics(prediction(Touch.SMOOTH, 0.0)))
    assert rough
    assert (rough.amplitude, rough.frequency) == (1.0, 60.0)
    # 8 bits for -1 to 1: steps of 0.008, 0.6 dB at the faint end.
    assert smooth
    assert 20 * math.log10(smooth.amplitude) == pytest.approx(-25, abs=0.7)
    assert smooth.frequency == 120.0


def test_no_touch_and_faults_are_silent_units() -> None:
    for silent in (
        prediction(Touch.NONE, 0.0),
        prediction(Touch.ROUGH, 1.0, faulty=True),
        prediction(Touch.ROUGH, math.nan),
    ):
        content = write_haptics(silent)
        assert is_silent(content)
        assert read_vibration(content) is None
        assert read_haptics(content, end=1.0).touch is Touch.NONE


@pytest.mark.parametrize("name", GOLDEN)
def test_the_bytes_stay_as_they_are(name: str) -> None:
    sent, golden = GOLDEN[name]
    assert write_haptics(sent) == bytes.fromhex(golden)


@pytest.mark.parametrize("kind", [0, 1, 3, 5, 6, 7])
def test_other_units_are_refused(kind: int) -> None:
    """Initialization and spatial units, aggregation and fragments: another sender's, or not a payload of haptics."""
    content = bytearray(write_haptics(prediction(Touch.ROUGH, 1.0)))
    content[0] = kind << 4
    with pytest.raises(PacketError):
        read_vibration(bytes(content))


@given(st.binary(max_size=64))
def test_any_bytes_are_read_or_refused(content: bytes) -> None:
    try:
        read_haptics(content, end=0.0)
    except PacketError:
        return


@given(st.integers(1, 280))
def test_a_cut_or_changed_unit_never_escapes(bit: int) -> None:
    content = int.from_bytes(write_haptics(prediction(Touch.ROUGH, 1.0)), "big") ^ 1 << (bit - 1)
    try:
        got = read_haptics(content.to_bytes(35, "big"), end=0.0)
    except PacketError:
        return
    assert 0 <= got.roughness <= 1


def test_a_packet_has_type_102_and_needs_no_other() -> None:
    packetizer = Packetizer(BlockEncoder(Codec("opus")), ssrc=1, redundancy=Redundancy(RedundancyRule()))
    sent = packetizer.wrap(PayloadType.HAPTICS, 512, write_haptics(prediction(Touch.ROUGH, 1.0)), marker=True)
    got = parse_packet(bytes(sent))
    assert (got.payload.kind, got.marker, bytes(sent)[1]) == (102, True, 0x80 | 102)
