"""Bitrate, delay, quality and cost of the codec settings: ``python benchmarks/codec.py``. Takes half a minute.

The input is two independent noises with the spectrum of touch (flat to 1 kHz, then -12 dB per octave; air 20 dB below
contact). The signal-to-noise ratio is that of the quieter channel, below 1 kHz (the band of the paper's detector) and
from 1 to 7.6 kHz.
"""

import time

import numpy as np

from tactophone.link import Codec, open_decoder, open_encoder, round_trip
from tactophone.link.receive_session import DATAGRAM_OVERHEAD
from tactophone.link.srtp import OVERHEAD
from tactophone.types import FloatArray

RATE = 48_000
RTP_HEADER = 12
CODECS = [
    Codec("pcm16", packet_size=128),
    *(Codec("opus", packet_size=size) for size in (120, 240, 480, 960)),
    *(Codec("opus", packet_size=size, bandwidth=7_600.0) for size in (120, 240, 480, 960)),
    Codec("opus", packet_size=240, bandwidth=7_600.0, bitrate_bps=96_000),
    Codec("opus", packet_size=240, bandwidth=20_000.0),
]


def touch(seconds: float = 4.0) -> FloatArray:
    random = np.random.default_rng(0)
    spectrum = np.fft.rfft(random.normal(0, 1, (round(seconds * RATE), 2)), axis=0)
    frequency = np.fft.rfftfreq(round(seconds * RATE), 1 / RATE)[:, np.newaxis]
    spectrum *= (frequency > 30) / (1 + (frequency / 1_000) ** 2)
    sound = np.fft.irfft(spectrum, axis=0)
    return (sound / sound.std(axis=0) * [0.1, 0.01]).astype(np.float32)


def band(sound: FloatArray, low: float, high: float) -> FloatArray:
    spectrum = np.fft.rfft(sound, axis=0)
    frequency = np.fft.rfftfreq(len(sound), 1 / RATE)
    spectrum[(frequency < low) | (frequency >= high)] = 0
    return np.fft.irfft(spectrum, len(sound), axis=0).astype(np.float32)


def quality_db(sound: FloatArray, decoded: FloatArray, low: float, high: float) -> float:
    error = band(decoded - sound, low, high)
    return float(min(20 * np.log10(band(sound, low, high).std(axis=0) / error.std(axis=0))))


def cost(codec: Codec, sound: FloatArray) -> tuple[float, float, int]:
    """Median microseconds to encode and to decode a packet in a loop without pauses, and its bytes."""
    encoder, decoder = open_encoder(codec), open_decoder(codec.kind)
    coding, decoding = [], []
    for start in range(0, len(sound) - codec.packet_size, codec.packet_size):
        begun = time.perf_counter()
        content = encoder.encode(sound[start : start + codec.packet_size])
        coded = time.perf_counter()
        decoder.decode(content)
        coding.append(coded - begun)
        decoding.append(time.perf_counter() - coded)
    return 1e6 * float(np.median(coding)), 1e6 * float(np.median(decoding)), len(content)


def row(codec: Codec, sound: FloatArray) -> str:
    decoded = round_trip(sound, codec)
    coding, decoding, octets = cost(codec, sound)
    packets = RATE / codec.packet_size
    wire = 8e-3 * packets * (octets + RTP_HEADER + OVERHEAD + DATAGRAM_OVERHEAD)
    setting = "" if codec.name == "pcm16" else f"{codec.bandwidth / 1000:g} kHz, {codec.bitrate_bps / 1000:g} kbit/s"
    return (
        f"| {codec.name} | {1e3 * codec.packet_size / RATE:.2f} | {setting} | {1e3 * codec.latency:.2f} | {wire:.0f} "
        f"| {quality_db(sound, decoded, 0, 1_000):.1f} | {quality_db(sound, decoded, 1_000, 7_600):.1f} "
        f"| {coding:.0f} / {decoding:.0f} |"
    )


def main() -> None:
    print(
        "| codec | packet, ms | setting | delay, ms | on the wire, kbit/s | SNR < 1 kHz, dB | 1-7.6 kHz, dB "
        "| encode / decode, us |\n|---|--:|---|--:|--:|--:|--:|--:|"
    )
    sound = touch()
    for codec in CODECS:
        print(row(codec, sound), flush=True)


if __name__ == "__main__":
    main()
