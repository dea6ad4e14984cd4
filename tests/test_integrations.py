"""The packages in integrations: what holds of each without its program."""

import ast
import tomllib
from pathlib import Path

import pytest

PACKAGES = sorted(
    path.parent
    for path in (Path(__file__).parents[1] / "integrations").glob("*/pyproject.toml")
)


@pytest.mark.parametrize("package", PACKAGES, ids=lambda path: path.name)
def test_a_package_has_a_name_a_readme_and_modules_that_parse(package: Path) -> None:
    project = tomllib.loads((package / "pyproject.toml").read_text())["project"]
    assert project["name"] == package.name
    assert f"{package.name}" in (package / "README.md").read_text()
    modules = list((package / package.name).glob("*.py"))
    assert modules
    for module in modules:
        ast.parse(module.read_text())
