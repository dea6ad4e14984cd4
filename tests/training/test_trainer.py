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
from tactophone.perception import magnitudes
from tactophone.training import trainer
from tactophone.training.network import Windows, find_windows, with_weights
from tactophone.training.recipes import NetworkSettings, network_settings
from tactophone.training.trainer import Progress, train
from tactophone.types import FloatArray


def make_windows(*, seconds: float = 2.0, seed: int = 0) -> Windows:
    """Two smooth and two rough sounds that differ in their spectra alone."""
    rng = np.random.default_rng(seed)
    time = np.arange(int(seconds * 2000)) / 2000
    labels = [Touch.SMOOTH, Touch.ROUGH] * 2
    pitch = {Touch.SMOOTH: 700.0, Touch.ROUGH: 90.0}
    sounds = [0.3 * np.sin(2 * np.pi * pitch[label] * time) + 0.05 * rng.normal(size=len(time)) for label in labels]
    signals = [np.stack([sound, sound / 4], axis=1).astype(np.float32) for sound in sounds]
    return find_windows(signals, labels, rule=network_settings("general").labelling)


def quick(**changes: object) -> NetworkSettings:
    return replace(
        network_settings("general"),
        **{"hop": 64, "batch_size": 64, "epochs": 3, "learning_rate": 1e-3, "least_steps": 0, **changes},
    )


def same(first: dict[str, FloatArray], second: dict[str, FloatArray]) -> bool:
    return all(np.array_equal(first[name], second[name]) for name in first)


def test_training_separates_two_sounds() -> None:
    windows, reports = make_windows(), list[Progress]()
    weights = train(windows, quick(epochs=6), report=reports.append)
    assert reports[-1].steps == reports[-1].total == len(reports)
    assert reports[-1].loss < reports[0].loss
    which = np.arange(0, len(windows), 50)
    predicted = with_weights(weights)(torch.from_numpy(magnitudes(windows.take(which)))).argmax(dim=1).numpy()
    assert (predicted == windows.labels[which]).mean() > 0.9


def test_the_same_seed_gives_the_same_bits_and_another_does_not() -> None:
    windows = make_windows()
    first, second, other = (train(windows, quick(), seed=seed) for seed in (1, 1, 2))
    assert same(first, second)
    assert not same(first, other)


def test_training_starts_from_initial_weights() -> None:
    windows = make_windows()
    start = train(windows, quick(epochs=1))
    assert same(train(windows, quick(epochs=1, learning_rate=0.0), initial=start), start)


def test_bfloat16_learns_too() -> None:
    reports: list[Progress] = []
    train(make_windows(), quick(precision="bfloat16", epochs=6), report=reports.append)
    assert reports[-1].loss < reports[0].loss


RUN = """
import sys
from pathlib import Path
from tactophone.training import trainer
from tests.training.test_trainer import make_windows, quick
trainer.CHECKPOINT_EVERY = 0.0
path = Path(sys.argv[1])
trainer.train(make_windows(), quick(), seed=5, checkpoint_path=path, report=lambda p: print(p.steps, flush=True))
"""


@pytest.mark.slow
def test_a_killed_run_resumes_and_ends_at_the_same_bits(tmp_path: Path) -> None:
    path = tmp_path / "run.unfinished"
    run = subprocess.Popen([sys.executable, "-c", RUN, str(path)], stdout=subprocess.PIPE, text=True)
    assert run.stdout is not None
    while not path.exists():
        assert run.stdout.readline(), "the run ended before its first checkpoint"
    os.kill(run.pid, signal.SIGKILL)
    run.communicate()
    reports: list[Progress] = []
    resumed = train(make_windows(), quick(), seed=5, checkpoint_path=path, report=reports.append)
    assert reports[0].steps > 1
    assert same(resumed, train(make_windows(), quick(), seed=5))


def test_a_checkpoint_of_other_sound_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(trainer, "CHECKPOINT_EVERY", 0.0)
    train(make_windows(), quick(epochs=1), checkpoint_path=tmp_path / "run.unfinished")
    with pytest.raises(ModelError, match="another recipe, seed or data"):
        train(make_windows(seed=1), quick(epochs=1), checkpoint_path=tmp_path / "run.unfinished")


@pytest.mark.parametrize("content", [b"", b"words", b"PK\x03\x04 half a file"])
def test_a_broken_checkpoint_says_what_to_do(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "run.unfinished").write_bytes(content)
    with pytest.raises(ModelError, match="delete it to start over"):
        train(make_windows(), quick(epochs=1), checkpoint_path=tmp_path / "run.unfinished")
