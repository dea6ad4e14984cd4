from pathlib import Path

import numpy as np
import pytest

from ablations import Ablation
from tactophone.core.errors import ConfigError
from tests.surfaces import surfaces


@pytest.mark.long
@pytest.mark.parametrize(
    "change", ["rate = 4000", "window = 0.128", "residual = false", "normalised = true"]
)
def test_an_ablation_predicts_at_the_live_times(tmp_path: Path, change: str) -> None:
    dataset, file = surfaces(tmp_path, each=1), tmp_path / "a.toml"
    file.write_text(
        'recipe = "paper-fast"\nepochs = 1\nleast_steps = 2\nbatch_size = '
        f'100\ncontact_threshold = "off"\n{change}\n'
    )
    ablation = Ablation.read(file)
    assert ablation.name.startswith("paper/general, ")
    found = ablation.fit(dataset.recordings)(dataset.recordings[0])
    assert np.diff(found.time) == pytest.approx(512 / 48_000, abs=1.1e-3)
    assert found.probabilities.sum(axis=1) == pytest.approx(1, abs=1e-4)


def test_a_file_of_another_recipe_is_refused(tmp_path: Path) -> None:
    (tmp_path / "a.toml").write_text('recipe = "texture"\n')
    with pytest.raises(ConfigError, match="ablations change the paper's network"):
        Ablation.read(tmp_path / "a.toml")
