"""Every script that is run explains its arguments and takes those that pages name, and
every library beside them finds what it imports."""

import argparse
import ast
import importlib
import re
import runpy
import shlex
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


def commands_in_pages() -> list[str]:
    """Return the scripts with arguments that pages tell their readers to run."""
    pages = [*ROOT.glob("*.md"), *ROOT.glob("*/*.md"), *(ROOT / "docs").rglob("*.md")]
    found = {
        re.split(r"  +", command.strip())[0]
        for page in pages
        for command in re.findall(
            r"(?<!:)python ((?:benchmarks|hardware|scripts)/[a-z]\w+\.py[^`\n]*)",
            page.read_text(encoding="utf-8"),
        )
    }
    return sorted(each for each in found if "..." not in each)


class ParsedError(Exception):
    """The arguments were taken; nothing is to be done with them."""


@pytest.mark.parametrize("command", commands_in_pages())
def test_a_script_takes_the_arguments_that_pages_name(
    command: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    name, *arguments = shlex.split(command)
    if name in BESIDE_AN_EXTRA:
        pytest.importorskip(BESIDE_AN_EXTRA[name])
    parse = argparse.ArgumentParser.parse_args

    def parse_only(parser: argparse.ArgumentParser, *args: object) -> None:
        parse(parser, *args)  # type: ignore[call-overload]
        raise ParsedError

    monkeypatch.syspath_prepend(str((ROOT / name).parent))
    monkeypatch.setattr(sys, "argv", [name, *arguments])
    monkeypatch.setattr(argparse.ArgumentParser, "parse_args", parse_only)
    with pytest.raises(ParsedError):
        runpy.run_path(str(ROOT / name), run_name="__main__")


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
