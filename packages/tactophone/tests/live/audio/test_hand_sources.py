"""Several recordings as the fingers of a hand."""

from functools import partial
from pathlib import Path

import numpy as np
import soundfile

from tactophone.core.types import FloatArray
from tactophone.live.audio.files import CombinedSource, FileSource, RecordedSource


def same(samples: FloatArray) -> FloatArray:
    return samples


def label(value: int, time: float) -> int:
    return value


def test_fingers_stand_side_by_side_and_the_shortest_ends_the_hand(
    tmp_path: Path,
) -> None:
    sources = []
    for number, (size, channels) in enumerate(((1000, 2), (700, 1))):
        path = tmp_path / f"{number}.wav"
        soundfile.write(
            path,
            np.full((size, channels), 0.25 * (number + 1)),
            48_000,
            subtype="FLOAT",
        )
        source = FileSource(path, block_size=256)
        sources.append(
            RecordedSource(
                source,
                duration=source.duration,
                resample=same,
                label_at=partial(label, number),
            )
        )
    with CombinedSource(sources) as hand:
        blocks = list(hand)
        sound = np.concatenate([block.samples for block in blocks])
        assert hand.channels == 4
        assert [hand.truth_of(finger) for finger in range(2)] == [0, 1]
    assert sound.shape == (700, 4)
    assert sound[0].tolist() == [0.25, 0.25, 0.5, 0.0]
    assert [block.start for block in blocks] == [0, 256, 512]
