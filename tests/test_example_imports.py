"""Every name of the package that an example, an integration or the ROS folder imports
exists."""

import ast
import importlib
from pathlib import Path

import pytest

ROOT = Path(__file__).parent.parent
FILES = sorted(
    path
    for folder in ("examples", "integrations", "ros")
    for path in (ROOT / folder).rglob("*.py")
)


@pytest.mark.parametrize("path", FILES, ids=lambda path: str(path.relative_to(ROOT)))
def test_what_an_example_imports_exists(path: Path) -> None:
    if "bridges" in (text := path.read_text()) and "ros" in text:
        pytest.importorskip("cyclonedds")
    for node in ast.walk(ast.parse(text)):
        names = (
            [alias.name for alias in node.names]
            if isinstance(node, ast.Import | ast.ImportFrom)
            else []
        )
        if (
            isinstance(node, ast.ImportFrom)
            and (node.module or "").partition(".")[0] == "tactophone"
        ):
            module = importlib.import_module(str(node.module))
            for name in names:
                if not hasattr(module, name):
                    importlib.import_module(f"{node.module}.{name}")
        elif isinstance(node, ast.Import):
            for name in names:
                if name.partition(".")[0] == "tactophone":
                    importlib.import_module(name)
