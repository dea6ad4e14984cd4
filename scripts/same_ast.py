#!/usr/bin/env python3
"""Checks that Python files differ from another commit in their layout alone: their
syntax trees are equal."""

import argparse
import ast
import subprocess
from pathlib import Path


def git(*words: str) -> str:
    return subprocess.run(
        ["git", *words], capture_output=True, text=True, check=True
    ).stdout


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("commit", help="what the working tree is compared with")
    commit = parser.parse_args().commit
    changed = git(
        "diff", "--name-only", "--diff-filter=M", commit, "--", "*.py"
    ).split()
    differ = [
        name
        for name in changed
        if ast.dump(ast.parse(git("show", f"{commit}:{name}")))
        != ast.dump(ast.parse(Path(name).read_text(encoding="utf-8")))
    ]
    print(f"{len(changed)} files compared, {len(differ)} differ", *differ, sep="\n")
    raise SystemExit(bool(differ))


if __name__ == "__main__":
    main()
