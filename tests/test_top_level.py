"""The top level of the repository holds what belongs there and nothing else."""

import subprocess
from pathlib import Path

import pytest

ROOT = Path(__file__).parents[1]

FOLDERS = {
    ".ci",
    ".github",
    "benchmarks",
    "docs",
    "examples",
    "hardware",
    "integrations",
    "packages",
    "requirements",
    "ros",
    "scripts",
    "tests",
}

FILES = {
    ".dockerignore",
    ".git-blame-ignore-revs",
    ".gitignore",
    ".pre-commit-config.yaml",
    "CHANGELOG.md",
    "CITATION.cff",
    "CONTRIBUTING.md",
    "Dockerfile",
    "LICENSE",
    "Makefile",
    "README.md",
    "SECURITY.md",
    "conftest.py",
    "mkdocs.yml",
    "models.mk",
    "pyproject.toml",
}


def test_nothing_else_stands_at_the_top() -> None:
    """A script that takes a wrong word for a folder makes one, and `git add` keeps
    it."""
    if not (ROOT / ".git").exists():
        pytest.skip("not a clone: the names are git's")
    listed = subprocess.run(
        ["git", "ls-files", "-z"], cwd=ROOT, check=True, capture_output=True, text=True
    )
    paths = listed.stdout.rstrip("\0").split("\0")
    assert {path.split("/")[0] for path in paths if "/" in path} == FOLDERS
    assert {path for path in paths if "/" not in path} == FILES
