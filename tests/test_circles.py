"""No module of either package imports itself through others, not even lazily or for
types alone."""

import ast
from graphlib import CycleError, TopologicalSorter
from pathlib import Path

import pytest

PACKAGES = Path(__file__).parent.parent / "packages"


def imports() -> dict[str, set[str]]:
    """Return the modules of both packages that each one imports, in functions and
    ``TYPE_CHECKING`` too."""
    paths = {
        ".".join(path.relative_to(source).with_suffix("").parts): path
        for source in PACKAGES.glob("*/src")
        for path in source.rglob("*.py")
    }
    modules = {name.removesuffix(".__init__"): path for name, path in paths.items()}
    found: dict[str, set[str]] = {}
    for name, path in modules.items():
        targets = found.setdefault(name, set())
        for node in ast.walk(ast.parse(path.read_text())):
            if isinstance(node, ast.ImportFrom) and node.module:
                both = (
                    {f"{node.module}.{alias.name}", node.module} for alias in node.names
                )
                targets |= {
                    max(each & modules.keys(), key=len)
                    for each in both
                    if each & modules.keys()
                }
            elif isinstance(node, ast.Import):
                targets |= {alias.name for alias in node.names} & modules.keys()
        targets.discard(name)
    return found


@pytest.mark.slow
def test_no_module_imports_itself_through_others() -> None:
    graph = imports()
    assert len(graph) > 150
    TopologicalSorter(graph).prepare()


def test_a_circle_would_be_found() -> None:
    graph = imports()
    graph["tactophone.core.types"].add("tactophone.app.tables")
    with pytest.raises(CycleError):
        TopologicalSorter(graph).prepare()
