"""Run a model file with NumPy and ONNX Runtime alone, as docs/reference/model-files.md
specifies it.

``python run_anywhere.py stylus.onnx stroke.wav [THRESHOLD_DBFS]`` prints, for each
window, its end in seconds, the probabilities of none, smooth and rough, the level in
dBFS, the touch, and the roughness. Needs numpy, onnxruntime and soundfile. Contact is
decided by a fixed threshold, the model's own unless one is given.
"""

import json
import math
import os
import sys
from collections.abc import Iterator
from fractions import Fraction

import numpy as np

# ONNX Runtime reports its use to its maker unless this is set before the import.
os.environ.setdefault("ORT_DISABLE_TELEMETRY", "1")

import onnxruntime
import soundfile
from numpy.lib.stride_tricks import sliding_window_view

FORGET_AFTER = 25  # windows without contact after which the next touch is a new one


def resample(sound: np.ndarray, rate: int, wanted: int) -> np.ndarray:
    """Return sound ``(channels, samples)`` at another rate; silence lies before and
    after it."""
    if rate == wanted:
        return sound
    common = math.gcd(rate, wanted)
    up, down = wanted // common, rate // common
    cutoff = 0.99 * min(rate, wanted) / rate
    reach = math.ceil(6 / cutoff)
    place = (np.arange(-reach, reach + 1) - np.arange(up)[:, None] / up) * cutoff
    kernels = np.sinc(place) * np.cos(np.clip(place, -6, 6) * np.pi / 12) ** 2
    kernels = (kernels / kernels.sum(axis=1, keepdims=True)).astype(np.float32)
    padded = np.pad(np.ascontiguousarray(sound), ((0, 0), (reach, reach)))
    windows = sliding_window_view(padded, 2 * reach + 1, axis=1)
    result = np.zeros((len(sound), -(-sound.shape[1] * up // down)), np.float32)
    # Output samples first, first + up, ... share a kernel.
    for first in range(min(up, result.shape[1])):
        part = result[:, first::up]
        # In float32, as networks of 8 bits amplify the last bit.
        part[:] = np.vecdot(
            windows[:, first * down // up :: down][:, : part.shape[1]],
            kernels[first * down % up],
        )
    return result


def level_dbfs(samples: np.ndarray, rule: str) -> float:
    """Return the level of a window's first channel by the rule of the model's gate."""
    samples, size = samples.astype(np.float64), len(samples)
    # The band lies between 1/32 and 1/2 of the Nyquist frequency; the taper is a
    # periodic Hann window.
    if rule == "banded":
        powers = np.abs(np.fft.rfft(samples * np.hanning(size + 1)[:-1])) ** 2
        amplitude = math.sqrt(
            2 * powers[size // 64 : size // 4].sum() / (3 / 8 * size**2)
        )
    elif rule == "rms":
        amplitude = math.sqrt(np.mean(samples**2))
    else:  # mean_absolute
        amplitude = float(np.abs(samples).mean())
    return (
        max(-200.0, round(20 * math.log10(amplitude), 6)) if amplitude > 0 else -200.0
    )


class Decision:
    """Turns the probabilities of each window into a touch and a roughness."""

    def __init__(self, rule: dict[str, float]) -> None:
        self.rule, self.rough, self.streak, self.quiet = rule, False, 0, 0

    def decide(self, probabilities: np.ndarray, contact: bool) -> tuple[str, float]:
        """Return the touch and the roughness, whose 0.5 is the threshold in force."""
        none, smooth, rough = map(float, probabilities)
        if not contact or none >= self.rule["abstain_from"]:
            self.streak, self.quiet = 0, self.quiet + 1
            self.rough = self.rough and self.quiet < FORGET_AFTER
            return ("smooth" if contact else "none"), 0.0
        self.quiet = 0
        share = rough / (smooth + rough) if smooth + rough > 0 else 0.5
        threshold = self.rule["rough_off"] if self.rough else self.rule["rough_on"]
        self.streak = self.streak + 1 if share >= self.rule["rough_on"] else 0
        self.rough = share >= threshold and (
            self.rough or self.streak >= self.rule["confirm"]
        )
        if share < threshold:
            return "smooth", 0.5 * share / threshold
        roughness = 0.5 + 0.5 * (share - threshold) / (1 - threshold)
        return (
            ("rough", roughness) if self.rough else ("smooth", math.nextafter(0.5, 0))
        )


def predict(
    model: str, path: str, threshold_dbfs: float | None = None
) -> Iterator[tuple]:
    """Yield the end of each window, its probabilities, level, touch and roughness."""
    session = onnxruntime.InferenceSession(model, providers=["CPUExecutionProvider"])
    card = json.loads(session.get_modelmeta().custom_metadata_map["tactophone.card"])
    sound, rate = soundfile.read(path, dtype="float32", always_2d=True)
    channels, size, hop = card["channels"], card["window_size"], Fraction(card["hop"])
    # One channel of two: the microphone that the card names. Channels that the
    # recording lacks are silent.
    first = int(
        channels < sound.shape[1] and card["settings"].get("microphone") == "air"
    )
    sound = sound.T[first : first + channels]
    sound = np.pad(sound, ((0, channels - len(sound)), (0, 0)))
    sound = resample(sound, rate, card["sample_rate"])
    threshold = (
        card["gate"]["threshold_dbfs"] if threshold_dbfs is None else threshold_dbfs
    )
    inputs = {each.name: each.shape for each in session.get_inputs()}
    state = np.zeros((1, inputs["state"][1])) if "state" in inputs else None
    decision, count = Decision(card["decision"]), 0
    while (end := size + int(count * hop)) <= sound.shape[1]:
        window = sound[:, end - size : end]
        level = level_dbfs(window[0], card["gate"]["rule"])
        feeds = {"sound": window[None]}
        if state is None:
            log_probabilities = session.run(["log_probabilities"], feeds)[0]
        else:
            feeds |= {
                "contact": np.array([level >= threshold], np.float32),
                "state": state,
            }
            log_probabilities, state = session.run(
                ["log_probabilities", "state_out"], feeds
            )
        probabilities = np.exp(log_probabilities[0])
        yield (
            end / card["sample_rate"],
            probabilities,
            level,
            *decision.decide(probabilities, level >= threshold),
        )
        count += 1


def as_text(
    end: float, probabilities: np.ndarray, level: float, touch: str, roughness: float
) -> str:
    """Return a line for a window."""
    none, smooth, rough = probabilities
    return (
        f"{end:.4f} {none:.6f} {smooth:.6f} {rough:.6f} {level:7.2f} {touch:6} "
        f"{roughness:.4f}"
    )


if __name__ == "__main__":
    for row in predict(*sys.argv[1:3], *map(float, sys.argv[3:4])):
        print(as_text(*row))
