"""Signal-to-noise ratio of touch by the encoder's complexity, with one or several
versions of libopus.

    python benchmarks/opus_search.py
    python benchmarks/opus_search.py --library /usr/local/lib/libopus.so.0 --library ...

Three sounds go through encoder and decoder: noise from 30 to 900 Hz, strokes, and taps.
The ratio is that of the contact channel under 1 kHz, where touch is felt. Encoding is
timed too, as the least of three runs; only times of one run compare.
"""

import argparse
import ctypes.util
import subprocess
import sys
import time

import numpy as np
from scipy.signal import butter, sosfilt, sosfiltfilt

from tactophone.core.microphones import CONTACT
from tactophone.core.types import LIVE_SAMPLE_RATE, FloatArray
from tactophone.net.link import codec as codecs
from tactophone.net.link.codec import Codec, open_decoder, open_encoder

COMPLEXITIES = (0, 2, 3, 4, 5, 9, 10)
"""Settings that are compared; 9 is libopus's default."""

PACKETS = (120, 240)
"""Samples of a packet: 2.5 and 5 ms."""

SECONDS = 4.0

LOOKAHEAD = 120
"""Samples by which decoded sound is behind."""

HIGHEST = 1_000.0
"""Hz under which touch is felt."""


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "--library",
        action="append",
        default=[],
        metavar="FILE",
        help="a libopus to compare (default: the system's)",
    )
    parser.add_argument("--child", help=argparse.SUPPRESS)
    args = parser.parse_args()
    if args.child is not None:
        print_rows(args.child)
        return
    names = " | ".join(map(str, COMPLEXITIES))
    print(
        f"| libopus | packet | sound | SNR in dB at complexity {names} "
        "| us to encode a packet, at each |"
    )
    print(f"|---|--:|---|{'--:|' * len(COMPLEXITIES)}---|")
    for library in args.library or [""]:
        # Each in a process of its own, as a library is loaded once.
        subprocess.run([sys.executable, __file__, "--child", library], check=True)


def print_rows(library: str) -> None:
    if library:
        ctypes.util.find_library = lambda name: library
    version = version_of(library or str(ctypes.util.find_library("opus")))
    for size in PACKETS:
        for name, sound in sounds().items():
            found = [measured(sound, size, complexity) for complexity in COMPLEXITIES]
            ratios = " | ".join(f"{ratio:.1f}" for ratio, _ in found)
            times = ", ".join(f"{microseconds:.0f}" for _, microseconds in found)
            print(
                f"| {version} | {1_000 * size / LIVE_SAMPLE_RATE:g} ms | {name} "
                f"| {ratios} | {times} |",
                flush=True,
            )


def version_of(library: str) -> str:
    opus = ctypes.CDLL(library)
    opus.opus_get_version_string.restype = ctypes.c_char_p
    return str(opus.opus_get_version_string().decode().removeprefix("libopus "))


def sounds() -> dict[str, FloatArray]:
    """Return sound at contact and air, ``(samples, 2)`` each."""
    size = round(SECONDS * LIVE_SAMPLE_RATE)
    times = np.arange(size) / LIVE_SAMPLE_RATE
    noise = np.random.default_rng(0).standard_normal((size, 2))
    band = butter(4, [30, 900], "band", fs=LIVE_SAMPLE_RATE, output="sos")
    low = sosfilt(band, noise, axis=0)
    swell = 0.003 + 0.1 * np.maximum(0.0, np.sin(2 * np.pi * 2 * times))
    tap = np.exp(-times[:4_800] / 0.008) * np.cos(2 * np.pi * 300 * times[:4_800])
    taps = 1e-4 * noise
    for start in range(0, size - len(tap), 9_600):
        taps[start : start + len(tap)] += tap[:, None] * [0.5, 0.15]
    found = {
        "noise 30-900 Hz": 0.05 * low / low.std(),
        "strokes": swell[:, None] * noise * [1.0, 0.3],
        "taps": taps,
    }
    return {name: sound.astype(np.float32) for name, sound in found.items()}


def measured(sound: FloatArray, size: int, complexity: int) -> tuple[float, float]:
    """Return the ratio in dB, and the least time to encode a packet in us."""
    codecs.COMPLEXITY = complexity
    codec = Codec("opus", packet_size=size)
    starts = range(0, len(sound) - size + 1, size)
    best = np.inf
    for _ in range(3):
        encoder, decoder = open_encoder(codec), open_decoder(codec.kind)
        began = time.thread_time()
        packets = [encoder.encode(sound[start : start + size]) for start in starts]
        best = min(best, (time.thread_time() - began) / len(starts))
    decoded = np.concatenate([decoder.decode(packet) for packet in packets])
    sent = sound[: len(decoded) - LOOKAHEAD, CONTACT]
    error = decoded[LOOKAHEAD:, CONTACT] - sent
    felt = butter(6, HIGHEST, fs=LIVE_SAMPLE_RATE, output="sos")
    ratio = sosfiltfilt(felt, sent).std() / sosfiltfilt(felt, error).std()
    return 20 * np.log10(ratio), 1e6 * best


if __name__ == "__main__":
    main()
