"""No dependency reports to its maker: the operator is a stranger to all of them."""

import os
import subprocess
import sys
from pathlib import Path

import pytest

from tactophone.core import usage_statistics

ROOT = Path(__file__).parents[4]


@pytest.mark.parametrize(
    "program",
    [
        "import tactophone.signal.perception.model_file, onnxruntime",
        "import tactophone_lab, onnxruntime",
        f"import sys; sys.path.insert(0, {str(ROOT / 'examples')!r}); import "
        "run_anywhere",
    ],
    ids=["the telephone", "the laboratory", "the exported example"],
)
def test_importing_onnx_runtime_leaves_no_file_in_the_users_home(
    program: str, tmp_path: Path
) -> None:
    environment = {
        name: value
        for name, value in os.environ.items()
        if name not in usage_statistics.SWITCHES and name != "XDG_CACHE_HOME"
    }
    subprocess.run(
        [sys.executable, "-B", "-c", program],
        env=environment | {"HOME": str(tmp_path)},
        check=True,
        timeout=120,
    )
    assert not [path for path in tmp_path.rglob("*") if path.is_file()]


def test_a_switch_that_the_user_has_set_stays() -> None:
    environment = {"ORT_DISABLE_TELEMETRY": "0"}
    usage_statistics.switch_off(environment)
    assert environment["ORT_DISABLE_TELEMETRY"] == "0"
    assert environment["RAY_USAGE_STATS_ENABLED"] == "0"
