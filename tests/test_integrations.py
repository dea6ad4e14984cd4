"""The packages in integrations: what holds of each without its program."""

import ast
import tomllib
from pathlib import Path

import pytest

from scripts.guest_readmes import blocks, installs

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


@pytest.mark.parametrize("package", PACKAGES, ids=lambda path: path.name)
def test_what_a_readme_installs_is_the_package_itself(package: Path) -> None:
    (line,) = installs((package / "README.md").read_text())
    assert line.endswith(f"./integrations/{package.name}")


def test_what_stands_after_a_program_is_no_command() -> None:
    readme = "```python\nimport a\n```\nProse.\n```\npip install a\n```\n"
    assert blocks(readme) == ["pip install a\n"]
    assert blocks(readme, "python") == ["import a\n"]
