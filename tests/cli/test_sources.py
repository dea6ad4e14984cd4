from pathlib import Path

from tactophone.capture import FileSource
from tactophone.cli.sources import Recorded
from tactophone.types import Touch
from tests.dataset.folders import audiofolder, write_sound


def test_a_recording_of_a_data_set_knows_its_truth(tmp_path: Path) -> None:
    folder = audiofolder(tmp_path)
    with Recorded(FileSource(folder / "audio" / "00_0.flac", block_size=480)) as recorded:
        truths = {recorded.truth_now() for _ in recorded}
    assert Touch.ROUGH in truths


def test_one_of_no_data_set_says_that_it_does_not_know(tmp_path: Path) -> None:
    with Recorded(FileSource(write_sound(tmp_path / "a.wav"), block_size=480)) as recorded:
        assert {recorded.truth_now() for _ in recorded} == {-1}
