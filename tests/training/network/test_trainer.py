import os
import signal
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from tactophone import ModelError, Touch
from tactophone.perception.features.spectrum import magnitudes
from tactophone.training.network import trainer
from tactophone.training.network.model import with_weights
from tactophone.training.network.recipe import Recipe, paper
from tactophone.training.network.trainer import Progress, train
from tactophone.training.network.windows import Windows, cut
from tactophone.types import FloatArray


def made(*, seconds: float = 2.0, seed: int = 0) -> Windows:
    """Two smooth and two rough sounds that differ in their spectra alone."""
    rng = np.random.default_rng(seed)
    time = np.arange(int(seconds * 2000)) / 2000
    labels = [Touch.SMOOTH, Touch.ROUGH] * 2
    pitch = {Touch.SMOOTH: 700.0, Touch.ROUGH: 90.0}
    sounds = [0.3 * np.sin(2 * np.pi * pitch[label] * time) + 0.05 * rng.normal(size=len(time)) for label in labels]
    signals = [np.stack([sound, sound / 4], axis=1).astype(np.float32) for sound in sounds]
    return cut(signals, labels, rule=paper("general").labelling)


def quick(**changes: object) -> Recipe:
    return replace(
        paper("general"),
        **{"hop": 64, "batch_size": 64, "epochs": 3, "learning_rate": 1e-3, "least_steps": 0, **changes},
    )


def same(one: dict[str, FloatArray], other: dict[str, FloatArray]) -> bool:
    return all(np.array_equal(one[name], other[name]) for name in one)


def test_learns_to_tell_two_sounds_apart() -> None:
    windows, told = made(), list[Progress]()
    weights = train(windows, quick(epochs=6), report=told.append)
    assert told[-1].steps == told[-1].of == len(told)
    assert told[-1].loss < told[0].loss
    which = np.arange(0, len(windows), 50)
    judged = with_weights(weights)(torch.from_numpy(magnitudes(windows.take(which)))).argmax(dim=1).numpy()
    assert (judged == windows.labels[which]).mean() > 0.9


def test_the_same_seed_gives_the_same_bits_and_another_does_not() -> None:
    windows = made()
    first, second, other = (train(windows, quick(), seed=seed) for seed in (1, 1, 2))
    assert same(first, second)
    assert not same(first, other)


def test_begins_from_given_weights() -> None:
    windows = made()
    start = train(windows, quick(epochs=1))
    assert same(train(windows, quick(epochs=1, learning_rate=0.0), initial=start), start)


def test_bfloat16_learns_too() -> None:
    told: list[Progress] = []
    train(made(), quick(precision="bfloat16", epochs=6), report=told.append)
    assert told[-1].loss < told[0].loss


RUN = """
import sys
from pathlib import Path
from tactophone.perception.features.spectrum import magnitudes
from tactophone.training.network import trainer
from tests.training.network.test_trainer import made, quick
trainer.SAVE_EVERY = 0.0
trainer.train(made(), quick(), seed=5, saved=Path(sys.argv[1]), report=lambda told: print(told.steps, flush=True))
"""


def test_a_killed_run_goes_on_and_ends_at_the_same_bits(tmp_path: Path) -> None:
    saved = tmp_path / "run.npz"
    run = subprocess.Popen([sys.executable, "-c", RUN, str(saved)], stdout=subprocess.PIPE, text=True)
    assert run.stdout is not None
    while not saved.exists():
        assert run.stdout.readline(), "the run ended before its first checkpoint"
    os.kill(run.pid, signal.SIGKILL)
    run.communicate()
    told: list[Progress] = []
    resumed = train(made(), quick(), seed=5, saved=saved, report=told.append)
    assert told[0].steps > 1
    assert same(resumed, train(made(), quick(), seed=5))


def test_a_checkpoint_of_other_sound_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(trainer, "SAVE_EVERY", 0.0)
    train(made(), quick(epochs=1), saved=tmp_path / "run.npz")
    with pytest.raises(ModelError, match="another recipe, seed or data"):
        train(made(seed=1), quick(epochs=1), saved=tmp_path / "run.npz")
