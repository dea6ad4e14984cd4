"""Bring your own sound: python examples/custom_source.py

A source yields blocks of float32 samples of shape (samples, channels). This one makes
noise in bursts; a driver for another sensor looks the same, with its device opened in
__enter__ and closed in __exit__.
"""

from collections.abc import Iterator

import numpy as np

from tactophone import AudioBlock, open_pipeline


class NoiseBursts:
    """Two seconds of two microphones: half a second of silence, half a second of noise,
    twice."""

    sample_rate = 48_000
    channels = 2

    def __enter__(self) -> "NoiseBursts":
        return self

    def __exit__(self, *_: object) -> None:
        pass

    def __iter__(self) -> Iterator[AudioBlock]:
        rng = np.random.default_rng(0)
        for start in range(0, 2 * self.sample_rate, 480):
            level = 0.1 if start % self.sample_rate >= self.sample_rate // 2 else 1e-5
            samples = rng.normal(scale=level, size=(480, 2)).astype(np.float32)
            yield AudioBlock(np.clip(samples, -1, 1), self.sample_rate, start)


if __name__ == "__main__":
    with NoiseBursts() as source:
        pipeline = open_pipeline(
            sample_rate=source.sample_rate, channels=source.channels
        )
        steps = [pipeline.push(block) for block in source]
    print([prediction.touch.name for step in steps for prediction in step.predictions])
