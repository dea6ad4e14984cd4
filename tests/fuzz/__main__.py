"""Fuzz all targets, or some, for a bounded time: ``python -m tests.fuzz --seconds 60
[TARGET ...]``.

With atheris (``pip install atheris``, Linux) inputs are guided by coverage, one process
a target, and its corpus is kept in ``build/fuzz``; otherwise they are mutated at
random. An input that raises what its parser does not document is kept in
``build/fuzz/crashes``; copy it to ``tests/data/crashes/TARGET/``, where a test repeats
it for ever.
"""

import argparse
import contextlib
import gc
import random
import subprocess
import sys
import time
import traceback
from importlib.util import find_spec
from pathlib import Path
from types import FunctionType

from . import TARGETS
from .target import Target, mutate

FOLDER = Path("build/fuzz")
SLOW = 2.0
"""Seconds of processor time from which an input counts as a hang: a busy machine may
hold any input up."""


def main() -> int:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument(
        "targets", nargs="*", choices=[*TARGETS, []], help="default: all"
    )
    parser.add_argument(
        "--seconds",
        type=float,
        default=60.0,
        help="for all targets together (default: 60)",
    )
    parser.add_argument(
        "--seed", type=int, default=1, help="of the random mutations (default: 1)"
    )
    parser.add_argument(
        "--random",
        action="store_true",
        help="mutate at random even where atheris is installed",
    )
    # Fuzzes one target in this process.
    parser.add_argument("--guided", action="store_true", help=argparse.SUPPRESS)
    args = parser.parse_args()
    names = args.targets or list(TARGETS)
    share = args.seconds / len(names)
    if args.guided:
        return guide(names[0], share)
    guided = find_spec("atheris") is not None and not args.random
    print("guided by coverage (atheris)" if guided else "mutated at random", flush=True)
    crashes = sum(
        launch(name, share) if guided else attack(name, TARGETS[name], share, args.seed)
        for name in names
    )
    print("no crash" if not crashes else f"{crashes} crashes in {FOLDER / 'crashes'}")
    return 1 if crashes else 0


def attack(name: str, target: Target, seconds: float, seed: int) -> int:
    """Mutate the seeds of a target at random; returns the number of different
    crashes."""
    seeds, run = target.prepare()
    dice = random.Random(seed)
    crashes = set[str]()
    count = 0
    until = time.monotonic() + seconds
    while time.monotonic() < until:
        data = dice.choice(seeds)
        if count:
            data = mutate(data, dice)
        begun = time.process_time()
        try:
            run(data)
        except target.documented:
            pass
        except Exception as error:
            crashes |= keep(name, data, error, crashes)
        if time.process_time() - begun > SLOW:
            crashes |= keep(name, data, TimeoutError(f"over {SLOW:g} s"), crashes)
        count += 1
    print(f"{name}: {count} inputs, {len(crashes)} crashes", flush=True)
    return len(crashes)


def keep(name: str, data: bytes, error: Exception, known: set[str]) -> set[str]:
    """Write an input that crashed, once for each place; returns the place."""
    frames = traceback.extract_tb(error.__traceback__)
    place = (
        f"{type(error).__name__} at {frames[-1].filename}:{frames[-1].lineno}"
        if frames
        else str(error)
    )
    if place not in known:
        path = FOLDER / "crashes" / name / f"{len(known)}.bin"
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_bytes(data)
        print(f"{name}: {place}: {str(error)[:100]!r}, kept in {path}", flush=True)
    return {place}


def launch(name: str, seconds: float) -> int:
    """Fuzz one target in a process of its own, which the library ends; returns whether
    it crashed."""
    command = [
        sys.executable,
        "-m",
        "tests.fuzz",
        "--guided",
        "--seconds",
        str(seconds),
        name,
    ]
    done = subprocess.run(
        command, check=False, timeout=seconds + 120, capture_output=True, text=True
    )
    lines = [
        line
        for line in (done.stdout + done.stderr).splitlines()
        if "DONE" in line or " exec/s" in line
    ]
    last = lines[-1].strip() if lines else ""
    crashed = " CRASHED" if done.returncode else ""
    print(f"{name}: {last}{crashed}", flush=True)
    if done.returncode:
        print(done.stderr[-1_500:], flush=True)
    return int(done.returncode != 0)


def guide(name: str, seconds: float) -> int:
    """Fuzz one target by coverage; the library ends the process."""
    import atheris

    target: Target = TARGETS[name]
    seeds, run = target.prepare()
    corpus, crashes = FOLDER / "corpus" / name, FOLDER / "crashes" / name
    for folder in (corpus, crashes):
        folder.mkdir(parents=True, exist_ok=True)
    for number, seed in enumerate(seeds):
        (corpus / f"seed-{number}").write_bytes(seed)

    def one(data: bytes) -> None:
        with contextlib.suppress(target.documented):
            run(data)

    # All loaded functions would take minutes; only the package's own are searched.
    for each in gc.get_objects():
        if isinstance(each, FunctionType) and str(each.__module__).startswith(
            "tactophone."
        ):
            atheris.instrument_func(each)
    limits = [
        f"-max_total_time={max(1, round(seconds))}",
        "-max_len=2048",
        f"-timeout={SLOW + 8:g}",
    ]
    atheris.Setup(
        [sys.argv[0], *limits, f"-artifact_prefix={crashes}/", str(corpus)], one
    )
    atheris.Fuzz()
    return 0


if __name__ == "__main__":
    sys.exit(main())
