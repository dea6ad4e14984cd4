#!/usr/bin/env python3
"""Runs the rows of docs/reference/paper.md whose command takes under a minute.

    python scripts/run_paper_rows.py            all of them: `make paper-rows`
    python scripts/run_paper_rows.py 14 20      those rows

A row of ``docs/reference/paper.toml`` with ``quick = true`` is run: every command that
it names and that begins with ``tactophone``, ``python`` or ``pytest``. Placeholders
stand for what is made first, in a folder that is removed: ``DIR`` a small simulated
data set in the authors' layout, ``FILE`` one of its recordings, ``HEIGHTS.npz`` a
profile, ``OUT`` a new folder. Ends with 1 if a row failed.
"""

import argparse
import os
import re
import shlex
import subprocess
import sys
import tempfile
import time
import tomllib
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).parent.parent
POINTS = ROOT / "docs" / "reference" / "paper.toml"

LONGEST = 600.0
"""Seconds after which a command is ended. A quick one takes under 60 on an idle core; a
shared one may take several times as long."""

COMMANDS = re.compile(r"`((?:tactophone|python|pytest) [^`]+)`")

PROGRAMS = {
    "tactophone": [sys.executable, "-m", "tactophone"],
    "python": [sys.executable],
    "pytest": [sys.executable, "-m", "pytest", "-q"],
}


def quick_points() -> list[dict[str, Any]]:
    """Return the rows whose command takes under a minute."""
    points = tomllib.loads(POINTS.read_text(encoding="utf-8"))["point"]
    return [point for point in points if point.get("quick") or point.get("run")]


def commands_of(
    point: Mapping[str, Any], inputs: Mapping[str, Path], out: Path
) -> list[list[str]]:
    """Return the commands of a row, with its placeholders filled."""
    found = []
    for number, words in enumerate(COMMANDS.findall(point["command"])):
        program, *rest = shlex.split(words)
        places = {**inputs, "OUT": out / f"{point['number']}-{number}"}
        filled = [str(places.get(word, word)) for word in rest]
        found.append([*PROGRAMS[program], *filled])
    return found


def make_inputs(folder: Path) -> dict[str, Path]:
    """Make what the placeholders stand for."""
    data, heights = folder / "data", folder / "heights.npz"
    simulate = [*PROGRAMS["tactophone"], "simulate"]
    chosen = "--objects 3,8,12,13,21,22 --takes long_medium,wiggle --seconds 4 --jobs 1"
    subprocess.run(
        [*simulate, "dataset", str(data), "--authors-layout", *chosen.split()],
        check=True,
        capture_output=True,
    )
    subprocess.run(
        [*simulate, "competition", str(data), "--authors-layout", "--runs", "1"],
        check=True,
        capture_output=True,
    )
    place = np.arange(0, 40e-3, 1e-6)
    np.savez(heights, heights=1e-6 * np.sin(2 * np.pi * place / 0.1e-3), step=1e-6)
    recording = data / "opus" / "stereo" / "08_wiggle.wav"
    return {"DIR": data, "FILE": recording, "HEIGHTS.npz": heights}


def run(command: list[str], folder: Path) -> tuple[int, str]:
    """Run a command; return its exit status, and the end of what it printed.

    The program itself runs in the folder, as some of its verbs write beside it.
    """
    writes_here = command[: len(PROGRAMS["tactophone"])] == PROGRAMS["tactophone"]
    paths = os.pathsep.join(map(str, sorted(ROOT.glob("packages/*/src"))))
    try:
        done = subprocess.run(
            command,
            check=False,
            cwd=folder if writes_here else ROOT,
            env={**os.environ, "PYTHONPATH": paths, "XDG_CACHE_HOME": str(folder)},
            capture_output=True,
            text=True,
            timeout=LONGEST,
        )
    except subprocess.TimeoutExpired:
        return 124, f"not finished after {LONGEST:.0f} s"
    return done.returncode, (done.stdout + done.stderr).strip()[-400:]


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("numbers", nargs="*", type=int, help="of rows; all by default")
    options = parser.parse_args()
    points = [
        point
        for point in quick_points()
        if not options.numbers or point["number"] in options.numbers
    ]
    failed = []
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        inputs = make_inputs(folder)
        for point in points:
            began = time.monotonic()
            for command in commands_of(point, inputs, folder):
                status, end = run(command, folder)
                if status:
                    failed.append(point["number"])
                    print(f"row {point['number']}: {shlex.join(command)}\n{end}")
            print(
                f"row {point['number']}: {time.monotonic() - began:.0f} s", flush=True
            )
    print(f"{len(points) - len(set(failed))} of {len(points)} rows did what they say")
    return int(bool(failed))


if __name__ == "__main__":
    raise SystemExit(main())
