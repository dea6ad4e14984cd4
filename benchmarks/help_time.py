"""How long each verb takes to answer ``--help`` and which imports take longest.

Run ``python benchmarks/help_time.py``, or ``python benchmarks/help_time.py VERB`` for
the slowest imports of one verb.
"""

import argparse
import statistics
import subprocess
import sys
import time

from tactophone.cli.verbs import all_verbs

REPEATS = 5
"""How often each verb is run; its median is printed."""


def main() -> None:
    """Print the median time of each verb, slowest first, or one verb's imports."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "verb",
        nargs="?",
        choices=sorted(all_verbs()),
        metavar="VERB",
        help="print the slowest imports of this verb instead",
    )
    args = parser.parse_args()
    if args.verb:
        print_imports(args.verb)
        return
    times = {verb: seconds(verb) for verb in all_verbs()}
    print(f"| verb | time of --help, s, median of {REPEATS} |\n|---|--:|")
    for verb, median in sorted(times.items(), key=lambda item: -item[1]):
        print(f"| {verb} | {median:.2f} |")


def seconds(verb: str) -> float:
    """Return the median time of ``tactophone VERB --help``."""
    command = [sys.executable, "-m", "tactophone", verb, "--help"]
    measured = []
    for _ in range(REPEATS):
        began = time.perf_counter()
        subprocess.run(command, check=True, stdout=subprocess.DEVNULL)
        measured.append(time.perf_counter() - began)
    return statistics.median(measured)


def print_imports(verb: str) -> None:
    """Print the 25 slowest imports of a verb's help: cumulative milliseconds, and the
    module."""
    command = [sys.executable, "-X", "importtime", "-m", "tactophone", verb, "--help"]
    report = subprocess.run(command, check=True, capture_output=True, text=True).stderr
    rows = [line.split("|") for line in report.splitlines()[1:] if line.count("|") == 2]
    rows = [row for row in rows if row[1].strip().isdigit()]
    print("| module | import, ms, with all that it imports |\n|---|--:|")
    for row in sorted(rows, key=lambda row: -int(row[1]))[:25]:
        print(f"| {row[2].strip()} | {int(row[1]) / 1000:.0f} |")


if __name__ == "__main__":
    main()
