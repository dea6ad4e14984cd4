"""The faults that `make mutants` puts into a file."""

import ast
import importlib.util
import sys
from pathlib import Path
from types import ModuleType

import pytest

ROOT = Path(__file__).parents[1]


@pytest.fixture(scope="module")
def mutation() -> ModuleType:
    spec = importlib.util.spec_from_file_location(
        "mutation", ROOT / "scripts" / "mutation.py"
    )
    assert spec
    assert spec.loader
    module = importlib.util.module_from_spec(spec)
    sys.modules["mutation"] = module
    spec.loader.exec_module(module)
    return module


def faulty(mutation: ModuleType, source: str, kind: str) -> list[str]:
    """Each fault of a kind, as the whole source that it makes."""
    tree = ast.parse(source)
    made = [
        ast.unparse(change.made_in(tree))
        for change in mutation.changes(tree)
        if change.kind == kind
    ]
    assert ast.unparse(tree) == ast.unparse(ast.parse(source))
    return made


@pytest.mark.parametrize(
    ("kind", "source", "made"),
    [
        ("operator", "found = a < b", ["found = a <= b"]),
        ("operator", "found = -a", ["found = a"]),
        ("argument", "f(a, b)", ["f(b, a)"]),
        ("argument", "f(local=a, remote=b)", ["f(local=b, remote=a)"]),
        ("argument", "f(a, a)", []),
        ("name", "a[AIR] + b[CONTACT]", ["a[CONTACT] + b[CONTACT]", "a[AIR] + b[AIR]"]),
        ("name", "a[AIR]", []),
        ("name", "a[:n]", ["a[n:]"]),
        ("comparison", "found = a and b", ["found = b", "found = a"]),
        ("comparison", "found = a < b < c", ["found = a < b", "found = b < c"]),
        (
            "comparison",
            "secrets.compare_digest(a, b)",
            ["secrets.compare_digest(a[:8], b[:8])"],
        ),
        ("line", "def f():\n    g()\n    h()", ["def f():\n    h()\n    g()"]),
        ("line", "def f():\n    a = g()\n    h(a)", []),
    ],
)
def test_a_kind_of_fault_is_made_at_each_place_and_undone(
    mutation: ModuleType, kind: str, source: str, made: list[str]
) -> None:
    assert faulty(mutation, source, kind) == made


def test_calls_and_changes_of_state_are_left_out_one_at_a_time(
    mutation: ModuleType,
) -> None:
    source = "self.silence()\nself.level = 1"
    assert faulty(mutation, source, "call") == [
        "pass\nself.level = 1",
        "self.silence()\npass",
    ]


def test_messages_and_docstrings_stay(mutation: ModuleType) -> None:
    source = '"""A text of 3 words."""\nraise ValueError(f"{a + 1} is too long")'
    assert list(mutation.changes(ast.parse(source))) == []
