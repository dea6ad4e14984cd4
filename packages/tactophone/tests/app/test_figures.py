from dataclasses import replace
from pathlib import Path

import pytest

from tactophone.app.figures import as_shown, draw_dataset, load_pyplot, save_figure
from tactophone_lab.datasets.open import open_dataset
from tests.folders import audiofolder


@pytest.mark.slow
def test_a_data_set_is_drawn_even_where_a_file_is_missing(tmp_path: Path) -> None:
    dataset = open_dataset(audiofolder(tmp_path))
    dataset.recordings[0].path.unlink()
    draw_dataset(tmp_path / "set.png", dataset)
    assert (tmp_path / "set.png").stat().st_size > 20_000


def test_a_figure_replaces_a_link_and_never_what_it_leads_to(tmp_path: Path) -> None:
    victim, picture = tmp_path / "victim.txt", tmp_path / "picture.png"
    victim.write_text("mine")
    picture.symlink_to(victim)
    figure = load_pyplot().figure()
    save_figure(figure, picture)
    assert victim.read_text() == "mine"
    assert picture.read_bytes()[1:4] == b"PNG"


@pytest.mark.parametrize("name", ["a$\\frac{$", "5$ or 10$", "$", "a\\$b", "$" * 9])
def test_a_name_with_dollar_signs_is_no_formula(name: str, tmp_path: Path) -> None:
    figure = load_pyplot().figure()
    text = figure.text(0, 0, as_shown(name))
    assert text._preprocess_math(text.get_text()) == (name, False)
    save_figure(figure, tmp_path / "picture.png")


@pytest.mark.slow
def test_a_data_set_with_a_formula_as_a_surface_is_drawn(tmp_path: Path) -> None:
    dataset = open_dataset(audiofolder(tmp_path))
    recordings = [
        replace(recording, surface="a$\\frac{$") for recording in dataset.recordings
    ]
    dataset = replace(dataset, recordings=tuple(recordings))
    draw_dataset(tmp_path / "set.png", dataset)
    assert (tmp_path / "set.png").stat().st_size > 20_000
