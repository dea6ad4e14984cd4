"""The example without Tactophone finds what Tactophone finds; it stands for readers who
follow the page alone."""

import ast
import runpy
import sys
from pathlib import Path

import numpy as np
import pytest
import soundfile

from tactophone.core.types import AudioBlock, Prediction, Touch
from tactophone.signal.perception.models import (
    model_path,
    open_touch_detector,
    shipped_models,
)
from tactophone_lab.simulation.demonstration import demonstration
from tests.sounds import blocks

EXAMPLE = Path(__file__).parent.parent / "examples" / "run_anywhere.py"
LMT = ("G1RhombAluminumMesh_01.flac", "G4Bamboo_01.flac", "G7FineFoamVersion2_01.flac")


@pytest.fixture(scope="module")
def simulated(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Six seconds of the simulated finger at a live system's rate, contact and air."""
    path = tmp_path_factory.mktemp("simulated") / "finger.wav"
    finger = demonstration(seed=3, tip="stylus")
    rendered = [finger.render(4800) for _ in range(60)]
    soundfile.write(
        path,
        np.concatenate([block.samples for block in rendered]),
        finger.sample_rate,
        subtype="FLOAT",
    )
    return path


def by_the_product(
    model: str, path: Path, threshold_dbfs: float = -40.0
) -> list[Prediction]:
    samples, rate = soundfile.read(path, dtype="float32", always_2d=True)
    detector = open_touch_detector(model, sample_rate=rate, contact="window")
    detector.threshold.dbfs = threshold_dbfs
    whole: list[AudioBlock] = list(blocks(samples, 480, sample_rate=rate))
    return [
        prediction for block in whole for prediction in detector.push(block)
    ] + detector.flush()


def by_the_example(model: str, path: Path, threshold_dbfs: float) -> list[list[str]]:
    """What the example prints, in the same process: a runtime takes a second to
    start."""
    module = runpy.run_path(str(EXAMPLE))
    return [
        module["as_text"](*row).split()
        for row in module["predict"](str(model_path(model)), str(path), threshold_dbfs)
    ]


def compare(model: str, path: Path) -> None:
    # A threshold at which the sound holds windows with and without contact.
    threshold_dbfs = round(
        float(np.median([each.level_dbfs for each in by_the_product(model, path)])), 1
    )
    expected, found = (
        by_the_product(model, path, threshold_dbfs),
        by_the_example(model, path, threshold_dbfs),
    )
    assert [row[5] for row in found] == [
        prediction.touch.name.lower() for prediction in expected
    ]
    numbers = np.array([[*row[:5], row[6]] for row in found], float)
    wanted = np.array(
        [
            (each.end, *each.probabilities, each.level_dbfs, each.roughness)
            for each in expected
        ]
    )
    assert np.abs(numbers[:, 0] - wanted[:, 0]).max() < 1e-4
    assert np.abs(numbers[:, 1:4] - wanted[:, 1:4]).max() < 1e-4
    assert np.abs(numbers[:, 4] - wanted[:, 4]).max() < 0.01
    assert np.abs(numbers[:, 5] - wanted[:, 5]).max() < 1e-3
    assert {each.touch for each in expected} > {Touch.NONE}


def test_it_imports_three_libraries() -> None:
    text = EXAMPLE.read_text()
    imported = {
        name.partition(".")[0]
        for node in ast.walk(ast.parse(text))
        for name in ([node.module or ""] if isinstance(node, ast.ImportFrom) else [])
        + ([alias.name for alias in node.names] if isinstance(node, ast.Import) else [])
    }
    assert imported - set(sys.stdlib_module_names) == {
        "numpy",
        "onnxruntime",
        "soundfile",
    }


@pytest.mark.slow
@pytest.mark.parametrize("model", shipped_models())
def test_simulated_sound_at_48_khz(model: str, simulated: Path) -> None:
    compare(model, simulated)


@pytest.mark.parametrize("name", LMT)
@pytest.mark.parametrize("model", ["stylus", "texture", "paper-mono"])
def test_real_sound_at_44100_hz(recordings: Path, model: str, name: str) -> None:
    compare(model, recordings / "lmt" / name)
