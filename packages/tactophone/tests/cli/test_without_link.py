import subprocess
import sys
from pathlib import Path

import pytest

from tactophone.core.extras import REQUIREMENT_OF_MODULE
from tests.cli.test_train import QUICK
from tests.folders import audiofolder

WITHOUT_LINK = """
import sys
from importlib.abc import MetaPathFinder

class Hidden(MetaPathFinder):
    def find_spec(self, name, path=None, target=None):
        if name.partition(".")[0] in {hidden!r}:
            raise ModuleNotFoundError(name=name)

sys.meta_path.insert(0, Hidden())
from tactophone.cli import main
sys.exit(main(sys.argv[1:]))
"""


def run_without_link(folder: Path, *words: str) -> subprocess.CompletedProcess[str]:
    hidden = {
        module
        for module, extra in REQUIREMENT_OF_MODULE.items()
        if extra == ("tactophone", "link")
    }
    code = WITHOUT_LINK.format(hidden=hidden)
    return subprocess.run(
        [sys.executable, "-c", code, *words],
        cwd=folder,
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )


@pytest.mark.slow
def test_training_needs_no_codec(tmp_path: Path) -> None:
    done = run_without_link(
        tmp_path,
        "train",
        str(audiofolder(tmp_path / "sound")),
        "--out",
        "a.onnx",
        *QUICK,
    )
    assert done.returncode == 0, done.stderr
    assert (tmp_path / "a.onnx").is_file()


@pytest.mark.realtime
def test_setting_up_a_finger_needs_no_codec(tmp_path: Path) -> None:
    words = (
        "setup --source finger --set simulation.gain_db=-20 --seconds 2 --yes "
        "--set process.name=setup-no-link"
    )
    done = run_without_link(tmp_path, *words.split())
    assert done.returncode == 0, done.stderr
    assert "written: finger.onnx" in done.stdout
