"""Runs the benchmarks in small settings, to see that each still reaches its end.

    python benchmarks/smoke.py [NAME ...]       `make benchmarks-smoke` runs all of them

What they print then is no measurement: a second of sound, few rounds, one finger. A row
says of each command how it ended; the exit status is 1 if one failed. Commands run one
after another. One that needs what is not installed is left out, and its row says what.
Where TACTOPHONE_RECORDINGS names a folder with `lmt`, four of its surfaces stand for
it; without, what needs real sound is left out.
"""

import argparse
import csv
import itertools
import os
import re
import shlex
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

ROOT = Path(__file__).parents[1]

LONGEST = 300.0
"""Seconds after which a command is ended."""

SETTINGS: Mapping[str, Sequence[str]] = {
    "airborne": ("--seconds 1",),
    "automatic_gain": ("{pad} --takes 1 --ways 'fixed gain' 'gate, all'",),
    "call_cost": ("--rounds 1 --seconds 2",),
    "call_delay": ("--count 100",),
    "compare": ("--takes 1 --profile paper graded --distorted kept",),
    "comparison": ("{random} --fit",),
    "cost": ("--only decode",),
    "demo_scores": ("--seeds 1",),
    "edges": (
        "{pad} --model texture",
        "{recordings}/lmt --kin benchmarks/lmt_kin.csv --tip stylus --split 2-fold",
    ),
    "endurance": (
        "--virtual-hours 0.01 --live-minutes 0",
        "--virtual-hours 0 --live-minutes 0.5",
        "--seeds 1 --night-hours 0.05 --night-sound 3",
    ),
    "failsafe": ("--kills 1",),
    "frozen_objects": ("{pad}",),
    "growth": ("--only fingers", "--only viewers,topics", "--only log,files"),
    "help_time": ("", "feel"),
    "latency": (
        "--only delays --impulses 3",
        "--only short --impulses 3",
        "--only peers --impulses 3",
        "--only failures",
    ),
    "latency_figure": ("{out}",),
    "link": ("--seconds 6 --datagrams 1000",),
    "live_compute": ("--runs 1",),
    "long_recording": ("--hours 0.002,0.004",),
    "moving": ("--seeds 1", "--data {pad}"),
    "no_touch": ("--seconds 1", "{stylus-model} --fit {stylus}"),
    "opus_search": ("",),
    "order": ("--kinds 4",),
    "page": tuple(
        f"{part} --repeats 2"
        for part in ("delays", "deadman", "microphone", "viewers", "game", "alone")
    ),
    "paper_rows": tuple(
        f"{row} texture"
        for row in ("slips", "pressure", "irregularities", "regularity")
    ),
    "paper_tables": (
        "1 2 --data {authors} --cache {out} --methods texture,rendered:texture",
        "3 --rounds 2 --methods texture,direct",
        "ablations --data {authors} --cache {out} --recipes {recipes}",
    ),
    "pictures": ("{out} --part listening", "{out} --part felt"),
    "printed_pad": ("--seconds 1",),
    "rendered_objects": (
        "{random} --save {out}/counts.json",
        "{random} --beside {out}/counts.json",
    ),
    "rendered_real": (
        "--takes 1 --distorted kept --save {out}/shares.json",
        "--takes 1 --distorted kept --against {out}/shares.json",
    ),
    "scale": (
        "--fingers 1 --impulses 3 --seconds 1 --sounds strokes",
        "--operators 1,2 --seconds 1",
    ),
    "simulation": ("",),
    "single_chunk": ("",),
    "strangers": ("--seconds 1 --connections 50 --https",),
    "tip_sounds": ("{pad} {stylus} --out {out}/tips.npz", "{pad} --seconds 1"),
    "touch_events": ("--objects 1",),
    "versions": ("--rounds 1 --seconds 1 --sounds air --fingers 1 --packets 5",),
}
"""Arguments of each command, by script. What stands in braces is made first."""

PARTS = frozenset({"smoke", "version_cost"})
"""Scripts that another one runs."""

PROGRAMS: Mapping[str, Sequence[str]] = {
    "call_cost": ("nft", "turnserver"),
    "cost": ("valgrind",),
    "failsafe": ("jackd",),
    "latency": ("jackd",),
    "page": ("chromium", "chromedriver"),
    "pictures": ("chromium", "chromedriver"),
    "scale": ("jackd",),
    "versions": ("jackd",),
}
"""Programs that a script needs."""

AS_ROOT = frozenset({"call_cost", "failsafe"})

WITH_LIMITS = frozenset({"endurance", "long_recording"})
"""Scripts that end with 1 where a value is beyond its limit, as in runs this short."""

ON_REAL_SOUND = frozenset({"compare", "rendered_real"})
"""Scripts that need TACTOPHONE_RECORDINGS."""

SURFACES = (
    "G1RhombAluminumMesh",
    "G2StoneTileVersion1",
    "G3AluminumPlate",
    "G4Bamboo",
)
"""Of `lmt`, two rough and two smooth ones of four kinds."""

TAKES = ("1", "2")
"""Of each of these surfaces."""

RECIPE = """
recipe = "paper-fast"
hop = 84
batch_size = 50
least_steps = 2
epochs = 1
"""
"""An ablation that is trained in seconds."""


class Inputs:
    """Makes what stands in braces, in a folder, when a command first needs it."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self._made: dict[str, Path] = {}
        self._makers: Mapping[str, Callable[[Path], None]] = {
            "pad": lambda path: simulate(path, "--objects 23,26,30,31 --tip pad"),
            "stylus": lambda path: simulate(path, "--objects 0,3,12,38 --tip stylus"),
            "random": lambda path: simulate(path, "--objects random:6:7"),
            "authors": make_authors_layout,
            "recordings": make_recordings,
            "recipes": lambda path: write(path / "small.toml", RECIPE),
            "stylus-model": copy_model,
            "out": lambda path: path.mkdir(),
        }

    @property
    def names(self) -> set[str]:
        """What may stand in braces."""
        return set(self._makers)

    def filled(self, text: str) -> list[str]:
        """Return the words of a command, with what they need made."""
        return shlex.split(
            re.sub(r"{([\w-]+)}", lambda found: str(self.path(found[1])), text)
        )

    def path(self, name: str) -> Path:
        if name not in self._made:
            path = self.folder / name
            self._makers[name](path)
            self._made[name] = path
        return self._made[name]


def simulate(path: Path, words: str) -> None:
    """Simulate takes of two seconds."""
    takes = "--takes long_medium,short_light,wiggle --seconds 2 --gain -12 --jobs 1"
    tactophone(f"simulate dataset {path} {words} {takes}")


def make_authors_layout(path: Path) -> None:
    chosen = "--objects 3,8,12,13,21,22 --takes long_medium --seconds 2 --jobs 1"
    tactophone(f"simulate dataset {path} --authors-layout {chosen}")
    tactophone(f"simulate competition {path} --authors-layout --runs 1")


def tactophone(words: str) -> None:
    command = [sys.executable, "-m", "tactophone", *shlex.split(words)]
    subprocess.run(command, check=True, env=environment(), capture_output=True)


def make_recordings(path: Path) -> None:
    """Copy the takes of a few surfaces of `lmt`, and the gripper."""
    real = Path(os.environ["TACTOPHONE_RECORDINGS"])
    (path / "lmt").mkdir(parents=True)
    with (real / "lmt" / "manifest.csv").open(encoding="utf-8", newline="") as file:
        reader = csv.DictReader(file)
        rows = [
            row
            for row in reader
            if row["surface"] in SURFACES and row["recording"] in TAKES
        ]
        columns = reader.fieldnames or []
    with (path / "lmt" / "manifest.csv").open("w", encoding="utf-8") as file:
        writer = csv.DictWriter(file, columns)
        writer.writeheader()
        writer.writerows(rows)
    for row in rows:
        shutil.copy(real / "lmt" / row["file"], path / "lmt")
    if (real / "gripper").is_dir():
        shutil.copytree(real / "gripper", path / "gripper")


def copy_model(path: Path) -> None:
    """Copy a model file, for a script that writes into it."""
    source = ROOT / "packages/tactophone/src/tactophone/signal/perception/models"
    shutil.copy(source / "stylus.onnx", path.with_suffix(".onnx"))
    path.symlink_to(path.with_suffix(".onnx"))


def write(path: Path, text: str) -> None:
    path.parent.mkdir()
    path.write_text(text, encoding="utf-8")


def environment() -> dict[str, str]:
    paths = os.pathsep.join(map(str, sorted(ROOT.glob("packages/*/src"))))
    return {**os.environ, "PYTHONPATH": paths}


def missing_for(name: str, arguments: str) -> str:
    """Return what a command needs and this machine has not, or nothing."""
    for program in PROGRAMS.get(name, ()):
        if shutil.which(program) is None:
            return f"needs {program}"
    if name in AS_ROOT and os.geteuid() != 0:
        return "needs root"
    if "--fit {stylus}" in arguments and shutil.which("espeak-ng") is None:
        return "needs espeak-ng"
    real = (
        name in ON_REAL_SOUND
        or "--data {pad}" in arguments
        or "{recordings}" in arguments
        or "--fit {stylus}" in arguments
    )
    if real and not has_recordings():
        return "needs TACTOPHONE_RECORDINGS with lmt"
    return ""


def has_recordings() -> bool:
    folder = os.environ.get("TACTOPHONE_RECORDINGS")
    return bool(folder) and Path(str(folder), "lmt", "manifest.csv").is_file()


def run(name: str, arguments: str, inputs: Inputs, longest: float) -> tuple[bool, str]:
    """Run a command; return whether it ended well, and how in words."""
    if missing := missing_for(name, arguments):
        return True, f"left out: {missing}"
    words = inputs.filled(arguments)
    settings = environment()
    if has_recordings():
        settings["TACTOPHONE_RECORDINGS"] = str(inputs.path("recordings"))
    else:
        settings.pop("TACTOPHONE_RECORDINGS", None)
    try:
        done = finished(
            [sys.executable, f"benchmarks/{name}.py", *words], settings, longest
        )
    except subprocess.TimeoutExpired:
        return False, f"not finished after {longest:.0f} s"
    beyond = name in WITH_LIMITS and "Traceback" not in done.stderr
    if done.returncode and not beyond:
        said = (done.stderr or done.stdout).strip().splitlines() or ["nothing said"]
        return False, f"exit {done.returncode}: {said[-1]}"
    if not done.stdout.strip() and "{out}" not in arguments:
        return False, "printed nothing"
    if row := uneven_row(done.stdout):
        return False, f"a row with other cells than the one above it: {row}"
    return True, "ended"


def finished(
    command: Sequence[str], settings: Mapping[str, str], longest: float
) -> "subprocess.CompletedProcess[str]":
    """Run a command to its end, or end it with all that it started.

    Raises `subprocess.TimeoutExpired` then.
    """
    with subprocess.Popen(
        command,
        cwd=ROOT,
        env=settings,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    ) as process:
        try:
            out, err = process.communicate(timeout=longest)
        except subprocess.TimeoutExpired:
            os.killpg(process.pid, signal.SIGKILL)
            raise
    return subprocess.CompletedProcess(command, process.returncode, out, err)


def uneven_row(text: str) -> str:
    """Return the first row that has more or fewer cells than the head of its table, or
    is in a table without a head; a line right below a table would be a row of it too.

    >>> uneven_row("| a | b |\\n|---|--:|\\n| 1 |\\n")
    '| 1 |'
    >>> uneven_row("| a |\\n|---|\\n\\n| 1 |\\n| 2 |\\n")
    '| 1 |'
    >>> uneven_row("| a |\\n|---|\\n| 1 |\\na note\\n")
    'a note'
    """
    lines = [*text.splitlines(), ""]
    head = ""
    for line, following in itertools.pairwise(lines):
        if not line.startswith("|"):
            if head and line:
                return line
            head = ""
            continue
        begins = not head
        head = head or line
        headless = begins and not following.startswith("|--")
        if headless or line.count("|") != head.count("|"):
            return line
    return ""


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "names",
        nargs="*",
        metavar="NAME",
        help=f"of {', '.join(SETTINGS)} (default: all)",
    )
    parser.add_argument(
        "--timeout",
        type=float,
        default=LONGEST,
        help="seconds for each command (default: %(default).0f)",
    )
    args = parser.parse_args()
    if unknown := sorted(set(args.names) - set(SETTINGS)):
        parser.error(f"no benchmark {unknown[0]!r}; there are {', '.join(SETTINGS)}")
    failed = 0
    print("| command | ended | s |\n|---|---|--:|")
    with tempfile.TemporaryDirectory() as folder:
        inputs = Inputs(Path(folder))
        for name in args.names or SETTINGS:
            for arguments in SETTINGS[name]:
                began = time.monotonic()
                well, words = run(name, arguments, inputs, args.timeout)
                failed += not well
                print(
                    f"| {name}.py {arguments} | {words} "
                    f"| {time.monotonic() - began:.0f} |",
                    flush=True,
                )
    print(f"\n{failed} failed" if failed else "\nall that could run reached their end")
    return int(bool(failed))


if __name__ == "__main__":
    raise SystemExit(main())
