from pathlib import Path

import numpy as np
import pytest
import soundfile

from tactophone import DatasetError
from tactophone.core.recordings.values import Recording, channel_order


def recording(*channels: str) -> Recording:
    return Recording(Path("a.wav"), "slate", channels=channels)


@pytest.mark.parametrize(
    ("channels", "count", "order"),
    [
        ((), 2, (0, 1)),
        ((), 1, (0,)),
        (("contact", "air"), 2, (0, 1)),
        (("air", "contact"), 2, (1, 0)),
        (("air", "contact"), 1, (1,)),
        (("air",), 1, (0,)),
    ],
)
def test_contact_comes_first_and_air_stands_in_where_there_is_no_other(
    channels: tuple[str, ...], count: int, order: tuple[int, ...]
) -> None:
    assert channel_order(recording(*channels), count=count) == order


@pytest.mark.parametrize("channels", [("air",), ("contact", "contact")])
def test_a_second_channel_is_never_made_up(channels: tuple[str, ...]) -> None:
    with pytest.raises(
        DatasetError, match="contact and air are needed; use the one-channel variant"
    ):
        channel_order(recording(*channels), count=2)


def test_a_recording_reads_contact_first_and_the_same_whole_or_in_blocks(
    tmp_path: Path,
) -> None:
    sound = np.random.default_rng(0).uniform(-0.5, 0.5, (1000, 2)).astype(np.float32)
    soundfile.write(tmp_path / "a.wav", sound, 8000, "FLOAT")
    take = Recording(tmp_path / "a.wav", "slate", channels=("air", "contact"))
    whole = take.read(channels=2)
    assert np.array_equal(whole.samples, sound[:, ::-1])
    blocks = list(take.blocks(channels=1, single="air", size=300))
    assert [block.start for block in blocks] == [0, 300, 600, 900]
    assert np.array_equal(
        np.concatenate([block.samples for block in blocks])[:, 0], sound[:, 0]
    )
    piece = take.read(start=0.05, duration=0.01)
    assert (piece.start, piece.size) == (400, 80)
    assert np.array_equal(piece.samples, sound[400:480])


def test_what_cannot_be_read_is_said_in_one_sentence(tmp_path: Path) -> None:
    (tmp_path / "a.wav").write_bytes(b"no sound")
    with pytest.raises(
        DatasetError,
        match=r"a\.wav: cannot be read as sound \(Format not recognised\); give a WAV",
    ):
        Recording(tmp_path / "a.wav", "slate").read()
    soundfile.write(tmp_path / "b.wav", np.zeros(80, np.float32), 8000)
    with pytest.raises(DatasetError, match="has 1 channel, but the model takes 2"):
        list(Recording(tmp_path / "b.wav", "slate").blocks(channels=2))
