"""Private names of other projects are used where `docs/reference/architecture.md` lists
them, and nowhere else."""

import ast
import importlib
import inspect
import pkgutil
import re
from collections.abc import Iterator
from pathlib import Path

import pytest

import tactophone

ROOT = Path(__file__).parents[1]
SOURCES = sorted((ROOT / "packages").glob("*/src/**/*.py"))
PAGE = ROOT / "docs/reference/architecture.md"


DOCUMENTED = {"_exit"}
"""Names with an underscore that their project documents as public (`os._exit`)."""


def is_private(name: str) -> bool:
    begins = name.startswith("_") and not name.startswith("__")
    return begins and name.strip("_") != "" and name not in DOCUMENTED


def listed() -> set[tuple[str, str]]:
    """Return the file and name of each row of the page's table."""
    section = PAGE.read_text().partition("## Private names of other projects")[2]
    rows = re.findall(r"^\| `([\w/.]+)` \| ([^|]*) \|", section, re.MULTILINE)
    return {
        (file, name) for file, names in rows for name in re.findall(r"`(\w+)`", names)
    }


def own_names() -> set[str]:
    """Return all private names that this repository defines itself."""
    found: set[str] = set()
    for path in SOURCES:
        for node in ast.walk(ast.parse(path.read_text())):
            match node:
                case ast.FunctionDef() | ast.AsyncFunctionDef() | ast.ClassDef():
                    found.add(node.name)
                case ast.Attribute(ctx=ast.Store(), value=ast.Name(id="self")):
                    found.add(node.attr)
                case ast.Name(ctx=ast.Store()):
                    found.add(node.id)
                case ast.keyword(arg=str(name)) | ast.alias(asname=str(name)):
                    found.add(name)
                case ast.alias(name=name):
                    found.add(name.rpartition(".")[2])
    return {name for name in found if is_private(name)}


def foreign_uses() -> Iterator[tuple[str, str]]:
    """Yield each use of a private name that nobody here defines, and each import of
    one from another project."""
    own = own_names()
    for path in SOURCES:
        file = path.name
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.Attribute) and is_private(node.attr):
                if node.attr not in own:
                    yield file, node.attr
            elif isinstance(node, ast.ImportFrom) and not node.level:
                ours = (node.module or "").startswith("tactophone")
                names = [] if ours else (node.module or "").split(".")
                if not ours:
                    names += [each.name for each in node.names]
                yield from ((file, name) for name in names if is_private(name))


def overridden() -> Iterator[tuple[str, str]]:
    """Yield each private method that a class here replaces in a class of another
    project."""
    for module in pkgutil.walk_packages(tactophone.__path__, "tactophone."):
        if module.name.endswith("__main__"):
            continue
        try:
            loaded = importlib.import_module(module.name)
        except Exception:  # an extra that is not installed here
            continue
        for _, kind in inspect.getmembers(loaded, inspect.isclass):
            if kind.__module__ != module.name:
                continue
            foreign = [
                base
                for base in kind.__mro__[1:]
                if not base.__module__.startswith("tactophone")
                and base.__module__ not in ("abc", "enum", "typing", "builtins")
            ]
            for name, value in vars(kind).items():
                replaces = any(name in vars(base) for base in foreign)
                if is_private(name) and inspect.isfunction(value) and replaces:
                    yield Path(inspect.getfile(kind)).name, name


def test_private_names_of_other_projects_are_listed_and_all_listed_are_used() -> None:
    used = {*foreign_uses(), *overridden()}
    assert used - listed() == set()
    unused = {
        (file, name)
        for file, name in listed()
        if not any(name in path.read_text() for path in SOURCES if path.name == file)
    }
    assert unused == set()


@pytest.mark.parametrize("name", ["_get_help_string", "_fill_text"])
def test_argparse_still_has_what_its_formatter_calls(name: str) -> None:
    import argparse

    assert f"self.{name}(" in inspect.getsource(argparse.HelpFormatter)


def test_argparse_still_has_what_its_parser_calls() -> None:
    import argparse

    source = inspect.getsource(argparse.ArgumentParser)
    assert "self._get_value(" in source
    assert "self._check_value(" in source
    assert argparse.ArgumentParser(add_help=False)._actions == []
