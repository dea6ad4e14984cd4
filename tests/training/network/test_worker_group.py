import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from tactophone.training.network.trainer import train
from tactophone.training.network.worker_group import WorkerGroup, init_distributed
from tests.training.network.test_trainer import make_windows, quick

SCRIPT = """
import sys
import numpy as np
from tactophone.training.network.worker_group import init_distributed
from tactophone.training.network.trainer import train
from tests.training.network.test_trainer import make_windows, quick

weights = train(make_windows(), quick(), seed=3)
np.savez(f"{sys.argv[1]}/{init_distributed().rank}.npz", **weights)
"""


def test_parts_cover_a_batch_once() -> None:
    places = [place for rank in range(3) for place in range(10)[WorkerGroup(rank, 3).part(10)]]
    assert places == list(range(10))


def test_without_torchrun_the_group_has_one_process(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.delenv("WORLD_SIZE", raising=False)
    assert init_distributed() == WorkerGroup(0, 1)
    assert init_distributed().leads


@pytest.mark.slow
def test_two_processes_under_torchrun_learn_what_one_does(tmp_path: Path) -> None:
    script = tmp_path / "script.py"
    script.write_text(SCRIPT)
    command = [sys.executable, "-m", "torch.distributed.run", "--standalone", "--nproc-per-node=2", script, tmp_path]
    environment = {**os.environ, "OMP_NUM_THREADS": "1", "PYTHONPATH": f"{Path.cwd()}{os.pathsep}{sys.path[0]}"}
    environment["PYTHONPATH"] += os.pathsep + os.environ.get("PYTHONPATH", "")
    subprocess.run([str(word) for word in command], check=True, env=environment, timeout=300)
    first, second = (dict(np.load(tmp_path / f"{rank}.npz")) for rank in range(2))
    alone = train(make_windows(), quick(), seed=3)
    for name, array in alone.items():
        assert np.array_equal(first[name], second[name])
        np.testing.assert_allclose(first[name], array, rtol=0, atol=2e-4)
