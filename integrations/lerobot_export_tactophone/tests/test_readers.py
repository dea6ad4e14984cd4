"""An export in the hands of LeRobot's own tools, and of the checkers of others.

lerobot 0.4.4 asks for torch under 2.11, so that these need an environment of their own;
each is skipped where its package is not installed.
"""

import os
import shutil
import subprocess
import sys
from pathlib import Path
from typing import Any

import pytest

from tactophone.cli import main

pytest.importorskip("pyarrow")

FEATURE = "observation.tactile.index"
ROBOT = Path(__file__).parent / "data/robot"
FRAMES = 45
"""Of each of the three episodes."""

CHECKERS = {
    "lerobot_doctor": "lerobot_doctor.cli check",
    "lerobot_lint": "lerobot_lint.cli check",
    "lerobot_quality_gates": "lerobot_quality_gates.cli check",
}


@pytest.fixture(scope="module")
def felt(log: Path, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A data set with touch in all of its episodes; the original stands beside it."""
    folder = tmp_path_factory.mktemp("readers")
    before = Path(shutil.copytree(ROBOT, folder / "orig"))
    for episode in range(3):
        out = folder / f"fel{episode}"
        command = [
            "export-lerobot",
            str(log),
            "--with",
            str(before),
            "--out",
            str(out),
            "--episode",
            str(episode),
        ]
        assert main(command) == 0
        before = out
    return before


def opened(root: Path) -> Any:
    os.environ["HF_HUB_OFFLINE"] = "1"
    datasets = pytest.importorskip("lerobot.datasets.lerobot_dataset")
    return datasets.LeRobotDataset("local/felt", root=root, video_backend="pyav")


@pytest.mark.slow
def test_lerobot_reads_every_frame_and_makes_policy_features_of_it(felt: Path) -> None:
    dataset = opened(felt)
    from lerobot.datasets.utils import dataset_to_policy_features

    assert len(dataset) == 3 * FRAMES
    width = len(dataset.meta.features[FEATURE]["names"])
    assert {dataset[place][FEATURE].shape for place in range(0, len(dataset), 10)} == {
        (width,)
    }
    assert dataset_to_policy_features(dataset.meta.features)[FEATURE].shape == (width,)


@pytest.mark.parametrize(
    ("tool", "words", "frames"),
    [
        ("delete_episodes", {"episode_indices": [1]}, 2 * FRAMES),
        ("split_dataset", {"splits": {"train": [0, 2]}}, 2 * FRAMES),
        ("remove_feature", {"feature_names": ["observation.images.front"]}, 3 * FRAMES),
        ("merge_datasets", {}, 6 * FRAMES),
    ],
)
def test_lerobots_own_tools_edit_it(
    felt: Path, tmp_path: Path, tool: str, words: dict[str, Any], frames: int
) -> None:
    dataset = opened(felt)
    tools = pytest.importorskip("lerobot.datasets.dataset_tools")
    out, first = tmp_path / "out", dataset
    if tool == "merge_datasets":
        first, words = [dataset, dataset], {"output_repo_id": "local/out"}
    getattr(tools, tool)(first, output_dir=out, **words)
    edited = opened(out / "train" if tool == "split_dataset" else out)
    assert len(edited) == frames
    place = frames - 1
    assert (
        edited[place][FEATURE].tolist() == dataset[len(dataset) - 1][FEATURE].tolist()
    )


@pytest.mark.parametrize("checker", CHECKERS)
def test_a_checker_finds_in_the_copy_what_it_finds_in_the_original(
    felt: Path, checker: str
) -> None:
    pytest.importorskip(checker)

    def report(root: Path) -> str:
        command = [sys.executable, "-m", *CHECKERS[checker].split(), str(root)]
        done = subprocess.run(
            command, capture_output=True, text=True, check=False, timeout=120
        )
        assert done.stdout, done.stderr
        return done.stdout.replace(str(root), "DATASET")

    assert report(felt) == report(felt.with_name("orig"))
