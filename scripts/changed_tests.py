#!/usr/bin/env python3
"""Prints the folders and files of tests that the changes since origin/main can break;
what lies on no floor breaks all.

A floor's tests run if something changed on it or beneath it. All of the laboratory is
one floor, above the telephone.
"""

import argparse
import subprocess
from pathlib import Path

TELEPHONE = ("core", "signal", "net", "live", "faces", "app", "cli")
"""Its floors, lowest first."""

LABORATORY = "lab"

APART = ("docs/", "README.md", "CHANGELOG.md", "CONTRIBUTING.md")
"""Read by the tests of the repository as a whole, which always run."""


def git(*words: str) -> list[str]:
    done = subprocess.run(["git", *words], capture_output=True, text=True, check=True)
    return done.stdout.split("\n")[:-1]


def floor(path: str) -> str:
    """Return the floor of a file of a package or of its tests; empty for any other."""
    match Path(path).parts:
        case ("packages", "tactophone", "src", _, str(name), *_) if name in TELEPHONE:
            return name
        case ("packages", "tactophone", "tests", str(name), *_) if name in TELEPHONE:
            return name
        case ("packages", "tactophone-lab", "src" | "tests", *_):
            return LABORATORY
    return ""


def main() -> None:
    argparse.ArgumentParser(description=__doc__).parse_args()
    since = git("merge-base", "HEAD", "origin/main")[0]
    changed = {
        *git("diff", "--name-only", since),
        *git("ls-files", "--others", "--exclude-standard"),
    }
    touched = {floor(path) for path in changed if not path.startswith(APART)}
    if "" in touched:
        print("tests packages")
        return
    run: list[str] = []
    lowest = min((TELEPHONE.index(name) for name in touched - {LABORATORY}), default=-1)
    if lowest >= 0:
        for name in TELEPHONE[lowest:]:
            run += [
                f"packages/tactophone/tests/{name}",
                f"packages/tactophone/src/tactophone/{name}",
            ]
    if touched:
        run.append("packages/tactophone-lab")
    print(*run, *sorted(map(str, Path("tests").glob("test_*.py"))))


if __name__ == "__main__":
    main()
