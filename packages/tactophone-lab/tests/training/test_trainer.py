import os
import signal
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import torch

from tactophone import DatasetError, ModelError, Touch
from tactophone.core.recordings.values import Dataset
from tactophone.core.types import FloatArray
from tactophone.signal.perception.model_file import Gate, read_model
from tactophone_lab.datasets.open import open_dataset
from tactophone_lab.training import trainer
from tactophone_lab.training import trainer as processor
from tactophone_lab.training.paper_network import (
    PaperNetwork,
    Windows,
    find_windows,
    magnitudes,
    weights_of,
    with_weights,
)
from tactophone_lab.training.recipe_options import (
    OPEN_GATE,
    NetworkSettings,
    network_settings,
)
from tactophone_lab.training.trainer import NetworkRecipe, Progress, TrainingRun
from tests.folders import audiofolder


def make_windows(*, seconds: float = 2.0, seed: int = 0) -> Windows:
    """Two smooth and two rough sounds that differ in their spectra alone."""
    rng = np.random.default_rng(seed)
    time = np.arange(int(seconds * 2000)) / 2000
    labels = [Touch.SMOOTH, Touch.ROUGH] * 2
    pitch = {Touch.SMOOTH: 700.0, Touch.ROUGH: 90.0}
    sounds = [
        0.3 * np.sin(2 * np.pi * pitch[label] * time)
        + 0.05 * rng.normal(size=len(time))
        for label in labels
    ]
    signals = [
        np.stack([sound, sound / 4], axis=1).astype(np.float32) for sound in sounds
    ]
    return find_windows(signals, labels, rule=network_settings("general").labelling)


def quick(**changes: object) -> NetworkSettings:
    return replace(
        network_settings("general"),
        **{
            "hop": 64,
            "batch_size": 64,
            "epochs": 3,
            "learning_rate": 1e-3,
            "least_steps": 0,
            **changes,
        },
    )


def same(first: dict[str, FloatArray], second: dict[str, FloatArray]) -> bool:
    return all(np.array_equal(first[name], second[name]) for name in first)


@pytest.mark.slow
def test_training_separates_two_sounds() -> None:
    windows, reports = make_windows(), list[Progress]()
    weights = TrainingRun(windows, quick(epochs=6)).complete(reports.append)
    assert reports[-1].steps == reports[-1].total == len(reports)
    assert reports[-1].loss < reports[0].loss
    which = np.arange(0, len(windows), 50)
    predicted = (
        with_weights(weights)(magnitudes(torch.from_numpy(windows.take(which))))
        .argmax(dim=1)
        .numpy()
    )
    assert (predicted == windows.labels[which]).mean() > 0.9


@pytest.mark.slow
def test_the_same_seed_gives_the_same_bits_and_another_does_not() -> None:
    windows = make_windows()
    first, second, other = (
        TrainingRun(windows, quick(), seed=seed).complete() for seed in (1, 1, 2)
    )
    assert same(first, second)
    assert not same(first, other)


def test_training_starts_from_initial_weights() -> None:
    windows = make_windows()
    start = TrainingRun(windows, quick(epochs=1)).complete()
    assert same(
        TrainingRun(
            windows, quick(epochs=1, learning_rate=0.0), initial=start
        ).complete(),
        start,
    )


@pytest.mark.slow
def test_bfloat16_learns_too() -> None:
    reports: list[Progress] = []
    TrainingRun(make_windows(), quick(precision="bfloat16", epochs=6)).complete(
        reports.append
    )
    assert reports[-1].loss < reports[0].loss


RUN = """
import sys
from pathlib import Path
from tactophone_lab.training import trainer
from tests.training.test_trainer import make_windows, quick
trainer.CHECKPOINT_EVERY = 0.0
path = Path(sys.argv[1])
run = trainer.TrainingRun(make_windows(), quick(), seed=5, checkpoint_path=path)
run.complete(lambda progress: print(progress.steps, flush=True))
"""


@pytest.mark.slow
def test_a_killed_run_resumes_and_ends_at_the_same_bits(tmp_path: Path) -> None:
    path = tmp_path / "run.unfinished"
    run = subprocess.Popen(
        [sys.executable, "-c", RUN, str(path)], stdout=subprocess.PIPE, text=True
    )
    assert run.stdout is not None
    while not path.exists():
        assert run.stdout.readline(), "the run ended before its first checkpoint"
    os.kill(run.pid, signal.SIGKILL)
    run.communicate()
    reports: list[Progress] = []
    resumed = TrainingRun(
        make_windows(), quick(), seed=5, checkpoint_path=path
    ).complete(reports.append)
    assert reports[0].steps > 1
    assert same(resumed, TrainingRun(make_windows(), quick(), seed=5).complete())


def test_a_checkpoint_of_other_sound_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(trainer, "CHECKPOINT_EVERY", 0.0)
    TrainingRun(
        make_windows(), quick(epochs=1), checkpoint_path=tmp_path / "run.unfinished"
    ).complete()
    with pytest.raises(ModelError, match="another recipe, seed or data"):
        TrainingRun(
            make_windows(seed=1),
            quick(epochs=1),
            checkpoint_path=tmp_path / "run.unfinished",
        ).complete()


@pytest.mark.parametrize("content", [b"", b"words", b"PK\x03\x04 half a file"])
def test_a_broken_checkpoint_says_what_to_do(tmp_path: Path, content: bytes) -> None:
    (tmp_path / "run.unfinished").write_bytes(content)
    with pytest.raises(ModelError, match="delete it to start over"):
        TrainingRun(
            make_windows(), quick(epochs=1), checkpoint_path=tmp_path / "run.unfinished"
        ).complete()


@pytest.mark.parametrize(
    ("flags", "fastest", "float32"),
    [
        ("sse2 avx2", "float32", "medium"),
        ("avx512_bf16", "bfloat16", "medium"),
        ("avx512_bf16 amx_bf16", "bfloat16", "highest"),
    ],
)
def test_float32_is_never_rounded(
    flags: str,
    fastest: str,
    float32: str,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    (tmp_path / "cpuinfo").write_text(f"flags\t\t: fpu {flags} lm\n")
    monkeypatch.setattr(processor, "CPU_FLAGS", tmp_path / "cpuinfo")
    assert processor.fastest_precision() == fastest
    assert processor.float32_products() == float32


def test_a_system_without_flags_is_taken_for_a_simple_one(
    monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    monkeypatch.setattr(processor, "CPU_FLAGS", tmp_path / "missing")
    assert processor.fastest_precision() == "float32"


SETTINGS = replace(
    network_settings("fine-tuned"), hop=64, batch_size=64, epochs=1, least_steps=0
)


def with_properties(dataset: Dataset, **properties: str) -> Dataset:
    changed = tuple(
        replace(take, properties={**take.properties, **properties})
        for take in dataset.recordings
    )
    return replace(dataset, recordings=changed)


@pytest.mark.parametrize(
    ("settings", "gate", "expected"),
    [
        (network_settings("general"), None, Gate(-26.0)),
        (
            network_settings("general", reference_code=True),
            None,
            Gate(-46.02, "mean_absolute"),
        ),
        (network_settings("general"), OPEN_GATE, OPEN_GATE),
    ],
)
def test_the_gate_is_of_paper_or_reference_code(
    settings: NetworkSettings, gate: Gate | None, expected: Gate
) -> None:
    assert NetworkRecipe(settings, gate=gate).effective_gate == expected


def test_the_card_names_sound_seed_and_licences(tmp_path: Path) -> None:
    dataset = with_properties(
        open_dataset(audiofolder(tmp_path / "stones")), licence="CC BY 4.0"
    )
    NetworkRecipe(SETTINGS, seed=7).train(tmp_path / "a.onnx", dataset)
    card = read_model(tmp_path / "a.onnx").card
    assert (
        card.training["dataset"],
        card.training["seed"],
        card.training["surfaces"],
    ) == ("stones", 7, 4)
    assert card.training["sha256"] == dataset.fingerprint
    assert (
        card.licence
        == "weights alone, no recordings; trained on sound under: CC BY 4.0"
    )
    assert card.scores == {}


def test_the_card_of_a_model_trained_on_simulated_sound_says_so(tmp_path: Path) -> None:
    dataset = with_properties(
        open_dataset(audiofolder(tmp_path / "stones")), source="simulated"
    )
    NetworkRecipe(SETTINGS).write(
        tmp_path / "a.onnx", weights_of(PaperNetwork()), dataset
    )
    card = read_model(tmp_path / "a.onnx").card
    assert "simulated sound alone" in card.licence
    assert "untested" in card.scores["real sound"]


def test_training_does_not_continue_from_a_model_of_other_channels(
    tmp_path: Path,
) -> None:
    dataset = open_dataset(audiofolder(tmp_path / "stones"))
    mono = NetworkRecipe(replace(SETTINGS, channels=1))
    mono.write(tmp_path / "mono.onnx", weights_of(PaperNetwork(channels=1)), dataset)
    job = NetworkRecipe(SETTINGS, start=tmp_path / "mono.onnx")
    with pytest.raises(ModelError, match="has 1 channel"):
        job.fit(job.read_windows(dataset.recordings))


def test_recordings_of_one_class_make_no_new_model(tmp_path: Path) -> None:
    dataset = open_dataset(audiofolder(tmp_path / "stones")).where(
        lambda take: take.label is Touch.ROUGH
    )
    job = NetworkRecipe(SETTINGS)
    with pytest.raises(DatasetError, match="rough surfaces alone"):
        job.fit(job.read_windows(dataset.recordings))
