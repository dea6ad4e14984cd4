"""Where is the simulated sound off? Prints docs/simulator-realism.md's second table and draws its picture.

python benchmarks/realism.py SIMULATED REAL [PICTURE]     (REAL: the folder of LMT recordings)
"""

import argparse
from pathlib import Path

from tactophone.benchmark.realism import draw_realism, measure_recordings, summary
from tactophone.dataset import open_dataset
from tactophone.types import AIR, CONTACT


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("simulated", type=Path)
    parser.add_argument("real", type=Path)
    parser.add_argument("picture", type=Path, nargs="?", default=Path("realism.png"))
    args = parser.parse_args()
    simulated = open_dataset(args.simulated).recordings
    real = [one for one in open_dataset(args.real).recordings if one.tier == "core"]
    groups = {
        "real (stylus, air)": measure_recordings(real, CONTACT),  # its only channel
        "simulated air": measure_recordings(simulated, AIR),
        "simulated contact": measure_recordings(simulated, CONTACT),
    }
    rows = {f"{name}, {label}": summary(found) for name, group in groups.items() for label, found in group.items()}
    names = next(iter(rows.values()))
    print("| median, dB | " + " | ".join(names) + " |\n|---|" + "--:|" * len(names))
    for name, row in rows.items():
        print(f"| {name} | " + " | ".join(f"{value:.1f}" for value in row.values()) + " |")
    draw_realism(args.picture, groups)
    print(f"\n{args.picture}")


if __name__ == "__main__":
    main()
