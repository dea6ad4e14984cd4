#!/usr/bin/env python3
"""Prints the folders and files of tests that the changes since origin/main can break;
what lies on no floor breaks all.

A floor's tests run if something changed on it or beneath it: `live` and `lab` do not
know each other.
"""

import subprocess
from pathlib import Path

BENEATH = {
    "core": (),
    "signal": ("core",),
    "net": ("core", "signal"),
    "lab": ("core", "signal", "net"),
    "live": ("core", "signal", "net"),
    "faces": ("core", "signal", "net", "lab", "live"),
    "app": ("core", "signal", "net", "lab", "live", "faces"),
    "cli": ("core", "signal", "net", "lab", "live", "faces", "app"),
}
APART = ("docs/", "README.md", "CHANGELOG.md", "CONTRIBUTING.md")
"""Read by the tests that always run, those beside the floors."""


def git(*words: str) -> list[str]:
    return subprocess.run(
        ["git", *words], capture_output=True, text=True, check=True
    ).stdout.split("\n")[:-1]


def floor(path: str) -> str:
    parts = Path(path).parts
    inside = (
        parts[2:3]
        if parts[:2] == ("src", "tactophone")
        else parts[1:2]
        if parts[0] == "tests"
        else ()
    )
    return inside[0] if inside and inside[0] in BENEATH else ""


since = git("merge-base", "HEAD", "origin/main")[0]
changed = {
    *git("diff", "--name-only", since),
    *git("ls-files", "--others", "--exclude-standard"),
}
touched = {floor(path) for path in changed if not path.startswith(APART)}
if "" in touched:
    print("tests src")
else:
    run = [name for name, beneath in BENEATH.items() if touched & {name, *beneath}]
    beside = sorted(str(path) for path in Path("tests").glob("test_*.py"))
    print(
        *(f"{root}/{name}" for root in ("tests", "src/tactophone") for name in run),
        *beside,
    )
