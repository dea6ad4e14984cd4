from pathlib import Path

from tactophone.lab.dataset.plots import draw_dataset
from tactophone.lab.dataset.read import open_dataset
from tests.lab.dataset.folders import audiofolder


def test_a_data_set_is_drawn_even_where_a_file_is_missing(tmp_path: Path) -> None:
    dataset = open_dataset(audiofolder(tmp_path))
    dataset.recordings[0].path.unlink()
    draw_dataset(tmp_path / "set.png", dataset)
    assert (tmp_path / "set.png").stat().st_size > 20_000
