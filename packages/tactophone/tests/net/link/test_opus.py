"""Calls of single streams against libopus's multistream API, which is the reference:
equal to the bit."""

import numpy as np
import pytest

from tactophone.core.errors import PacketError
from tactophone.core.types import FloatArray
from tactophone.net.link.codec import (
    Codec,
    OpusDecoder,
    OpusEncoder,
    open_decoder,
    open_encoder,
)
from tactophone.net.link.packet import FRAME_SIZES, split_streams


def encode_by_reference(encoder: OpusEncoder, samples: FloatArray) -> bytes:
    encoder._sound[:, : len(samples)] = samples.T
    return b"".join(finger._encode_first(len(samples)) for finger in encoder._fingers)


def decode_by_reference(decoder: OpusDecoder, content: bytes, size: int) -> FloatArray:
    for finger, part in zip(decoder._fingers, decoder._split(content), strict=True):
        finger._decode_together(part, size)
    return decoder._sound[:, :size].T.copy()


def sounds(channels: int, sizes: list[int]) -> list[FloatArray]:
    """Noise of all levels, with silence and a full-scale stretch in it, different in
    each channel."""
    random = np.random.default_rng(0)
    found = []
    for number, size in enumerate(sizes):
        level = 0.0 if number % 11 < 2 else 10 ** random.uniform(-5, 0.3, channels)
        found.append(
            (level * random.standard_normal((size, channels))).astype(np.float32)
        )
    return found


@pytest.mark.parametrize(
    "bitrate_kbps", [0, 12, 24, 510, 1500], ids=lambda rate: f"{rate}kbps"
)
@pytest.mark.parametrize("bandwidth", [4000, 20_000])
@pytest.mark.parametrize("size", FRAME_SIZES)
@pytest.mark.parametrize("channels", [1, 2])
def test_payloads_and_sound_equal_those_of_the_multistream_api(
    channels: int, size: int, bandwidth: float, bitrate_kbps: int
) -> None:
    codec = Codec("opus", channels, size, bandwidth, 1000 * bitrate_kbps)
    check_equality(codec, [size] * 60)


def test_a_hand_equals_the_multistream_api() -> None:
    check_equality(Codec("opus", channels=10, packet_size=120), [120] * 40)


def test_packets_of_changing_sizes_equal_the_multistream_api() -> None:
    sizes = np.random.default_rng(1).choice([120, 120, 240, 480], 120).tolist()
    check_equality(Codec("opus", packet_size=480), sizes)


def check_equality(codec: Codec, sizes: list[int]) -> None:
    encoder, other_encoder = open_encoder(codec), open_encoder(codec)
    decoder, other_decoder = open_decoder(codec.kind), open_decoder(codec.kind)
    assert isinstance(other_encoder, OpusEncoder)
    assert isinstance(other_decoder, OpusDecoder)
    for number, samples in enumerate(sounds(codec.channels, sizes)):
        payload = encoder.encode(samples)
        assert payload == encode_by_reference(other_encoder, samples)
        if number % 17 == 16:  # lost, and concealed by both
            lost = (
                decoder.conceal(len(samples), None),
                other_decoder.conceal(len(samples), None),
            )
            np.testing.assert_array_equal(*lost)
        else:
            expected = decode_by_reference(other_decoder, payload, len(samples))
            np.testing.assert_array_equal(decoder.decode(payload), expected)


def test_altered_payloads_are_decoded_or_refused_as_by_the_multistream_api() -> None:
    random, codec = np.random.default_rng(2), Codec("opus", packet_size=120)
    kind = codec.kind
    encoder = open_encoder(codec)
    decoder = open_decoder(kind)
    other = open_decoder(kind)
    assert isinstance(other, OpusDecoder)
    refused = 0
    for samples in sounds(2, [120] * 400):
        payload = bytearray(encoder.encode(samples))
        for place in random.choice([0, 1, 2, len(payload) // 2, len(payload) - 1], 2):
            payload[place] = random.integers(256)
        altered = bytes(payload[: random.integers(1, len(payload) + 1)])
        try:
            expected = decode_by_reference(other, altered, other.size(altered))
        except PacketError:
            refused += 1
            with pytest.raises(PacketError):
                decoder.decode(altered)
        else:
            np.testing.assert_array_equal(decoder.decode(altered), expected)
    assert 50 < refused < 350


@pytest.mark.parametrize(
    "payload", [b"", b"\xe0", b"\xe0\x01", b"\xe0\x05\x00\xe0", b"\xe1\x01\x00\xe1\x00"]
)
def test_payloads_that_are_not_one_frame_of_each_stream_are_not_split(
    payload: bytes,
) -> None:
    assert split_streams(payload, 2) == []
