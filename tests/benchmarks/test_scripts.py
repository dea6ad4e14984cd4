"""Every script of `benchmarks` still finds the names that it imports, and prints its
help."""

import importlib
import sys
from pathlib import Path

import pytest

SCRIPTS = sorted(
    path.stem for path in Path(__file__).parents[2].glob("benchmarks/*.py")
)


@pytest.mark.parametrize("name", SCRIPTS)
def test_a_script_finds_what_it_imports_and_prints_its_help(
    name: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    module = importlib.import_module(name)
    if hasattr(module, "argparse") and hasattr(module, "main"):
        monkeypatch.setattr(sys, "argv", [name, "--help"])
        with pytest.raises(SystemExit) as ended:
            module.main()
        assert ended.value.code == 0
        assert "usage: " in capsys.readouterr().out
