from collections.abc import Iterator

import numpy as np
import pytest

from tactophone.core.errors import DatasetError
from tactophone.core.types import AudioBlock
from tactophone_lab.recording.protocol import Key
from tactophone_lab.recording.sound_taker import SoundTaker


def sound(count: int) -> Iterator[AudioBlock]:
    """Some blocks, and then a failure."""
    for place in range(count):
        yield AudioBlock(np.zeros((480, 1), np.float32), 48_000, 480 * place)
    raise DatasetError("the file is damaged")


@pytest.mark.parametrize("ahead", [True, False])
def test_sound_comes_with_its_keys_and_then_what_failed(ahead: bool) -> None:
    keys = iter([None, Key.GO, None])
    with SoundTaker(sound(3), lambda: next(keys), ahead=ahead) as taker:
        blocks = iter(taker)
        taken = [next(blocks) for _ in range(3)]
        assert [key for _, key in taken] == [None, Key.GO, None]
        assert [block.start for block, _ in taken] == [0, 480, 960]
        with pytest.raises(DatasetError, match="damaged"):
            next(blocks)


def test_a_reader_that_ends_early_ends_the_thread() -> None:
    with SoundTaker(sound(10**9), lambda: None, ahead=True) as taker:
        next(iter(taker))
    taker._thread.join(10.0)
    assert not taker._thread.is_alive()
