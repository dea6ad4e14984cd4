"""Your own detector, from scikit-learn: python examples/own_detector.py none.wav
smooth.wav rough.wav finger.wav

In a package, `[project.entry-points."tactophone.detectors"]` with `mine =
"package:make"` lets `--set detector.model=mine` and `open_pipeline("mine", ...)` find
it; `make(sample_rate=..., channels=...)` returns it.
"""

import sys
from collections import Counter

import numpy as np
from sklearn.linear_model import LogisticRegression

from tactophone import (
    AudioBlock,
    ContactThreshold,
    FileSource,
    Limits,
    Pipeline,
    Prediction,
    Touch,
    open_profile,
)


class Own:
    """Tells none, smooth and rough by the energies of 16 bands of windows of 20 ms."""

    name, latency, bandwidth = "own", 0.0, 24_000.0

    def __init__(self, model: LogisticRegression, rate: int) -> None:
        self.model, self.rate, self.size = model, rate, rate // 50
        self.faults, self.threshold = Counter[str](), ContactThreshold(-60.0)
        self.reset()

    def reset(self) -> None:
        """Forget the sound so far."""
        self.rest, self.start = np.empty(0, np.float32), 0

    def push(self, block: AudioBlock) -> list[Prediction]:
        """Return a prediction for each window that the block completes."""
        self.rest, found = np.concatenate((self.rest, block.samples[:, 0])), []
        while len(self.rest) >= self.size:
            window, self.rest = self.rest[: self.size], self.rest[self.size :]
            chances = tuple(map(float, self.model.predict_proba([features(window)])[0]))
            level = 10 * np.log10(np.mean(np.square(window, dtype=float)) + 1e-20)
            touch = (
                Touch(int(np.argmax(chances)))
                if level > self.threshold.dbfs
                else Touch.NONE
            )
            bounds, self.start = (
                (self.start / self.rate, (self.start + self.size) / self.rate),
                self.start + self.size,
            )
            roughness = chances[2] / (chances[1] + chances[2] + 1e-9)
            found.append(Prediction(chances, touch, roughness, level, *bounds))
        return found

    def flush(self) -> list[Prediction]:
        """Return nothing: half a window is dropped."""
        return []


def features(window: np.ndarray) -> np.ndarray:
    """Return the energies in dB of 16 bands."""
    power = np.abs(np.fft.rfft(window)) ** 2
    return 10 * np.log10([part.sum() + 1e-12 for part in np.array_split(power, 16)])


def windows(path: str) -> list[np.ndarray]:
    """Return the features of all windows of a recording."""
    with FileSource(path) as source:
        sound = np.concatenate([block.samples[:, 0] for block in source])
        size = source.sample_rate // 50
    return [features(sound[at : at + size]) for at in range(0, len(sound) - size, size)]


if __name__ == "__main__":
    *labelled, path = sys.argv[1:]
    taught = [
        (row, touch) for touch, name in enumerate(labelled) for row in windows(name)
    ]
    model = LogisticRegression(max_iter=1000).fit(*map(list, zip(*taught, strict=True)))
    with FileSource(path) as source:
        pipeline = Pipeline(
            Own(model, source.sample_rate), open_profile("paper"), Limits()
        )
        for block in source:
            for prediction in pipeline.push(block).predictions:
                print(
                    f"{prediction.end:8.3f} s  {prediction.touch.name.lower():6}  "
                    f"{prediction.roughness:.2f}"
                )
