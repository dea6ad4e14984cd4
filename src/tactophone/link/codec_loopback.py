"""The codec without the network, for training and studies."""

import numpy as np

from tactophone.link.codec import Codec, open_decoder, open_encoder
from tactophone.types import FloatArray


def round_trip(samples: FloatArray, codec: Codec) -> FloatArray:
    """Encode and decode sound at 48 kHz, shape ``(samples, channels)``; the result is aligned and of the same shape.

    >>> sound = np.linspace(-1, 1, 1000, dtype=np.float32)[:, None]
    >>> bool(np.abs(round_trip(sound, Codec("pcm16", channels=1)) - sound).max() < 1e-4)
    True
    """
    # The codec delays by its look-ahead: the sound is padded at the end and the result cut at the start.
    encoder, decoder = open_encoder(codec), open_decoder(codec.kind)
    packets = -(-(len(samples) + codec.lookahead) // codec.packet_size)
    padded = np.zeros((packets * codec.packet_size, samples.shape[1]), np.float32)
    padded[: len(samples)] = samples
    decoded = [decoder.decode(encoder.encode(block)) for block in padded.reshape(packets, codec.packet_size, -1)]
    return np.concatenate(decoded)[codec.lookahead : codec.lookahead + len(samples)]
