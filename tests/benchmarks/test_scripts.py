"""Every script that is run explains its arguments, and every library beside them finds
what it imports."""

import ast
import importlib
import runpy
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[2]

BESIDE_AN_EXTRA = {
    "hardware/fingertip.py": "build123d",
    "hardware/pictures.py": "manifold3d",
    "scripts/docs_hooks.py": "mkdocs",
}
"""Scripts that need a library which `make test` does not install everywhere."""


def is_run(path: Path) -> bool:
    """Return whether a module does something when Python runs it as a program."""
    return any(
        isinstance(node, ast.If) and "__main__" in ast.unparse(node.test)
        for node in ast.parse(path.read_text(encoding="utf-8")).body
    )


FILES = {
    path.relative_to(ROOT).as_posix(): is_run(path)
    for folder in ("benchmarks", "hardware", "scripts")
    for path in sorted((ROOT / folder).glob("*.py"))
}
SCRIPTS = [name for name, run in FILES.items() if run]
LIBRARIES = [name for name, run in FILES.items() if not run]


@pytest.mark.parametrize("name", SCRIPTS)
def test_a_script_prints_its_help_and_does_nothing_else(
    name: str, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    if name in BESIDE_AN_EXTRA:
        pytest.importorskip(BESIDE_AN_EXTRA[name])
    monkeypatch.syspath_prepend(str((ROOT / name).parent))
    monkeypatch.setattr(sys, "argv", [name, "--help"])
    with pytest.raises(SystemExit) as ended:
        runpy.run_path(str(ROOT / name), run_name="__main__")
    assert ended.value.code == 0
    assert "usage: " in capsys.readouterr().out


@pytest.mark.parametrize("name", LIBRARIES)
def test_a_library_beside_the_scripts_finds_what_it_imports(
    name: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    if name in BESIDE_AN_EXTRA:
        pytest.importorskip(BESIDE_AN_EXTRA[name])
    monkeypatch.syspath_prepend(str((ROOT / name).parent))
    importlib.import_module(Path(name).stem)
