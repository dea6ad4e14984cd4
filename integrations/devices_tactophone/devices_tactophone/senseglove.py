"""SenseGlove Nova 2: ``python -m devices_tactophone.senseglove RUN | ./nova2 right``
(`nova2.cpp`, with its SDK).

Prints ``finger amplitude hertz`` of what vibrates, every `INTERVAL` s; each lasts 0.1 s
at the glove.
"""

import sys
import time

from tactophone import HapticCommand
from tactophone.live.log.reader import PredictionReader

INTERVAL = 0.05


def lines(newest: dict[str, HapticCommand]) -> list[str]:
    """Return a line for each finger that vibrates."""
    return [
        f"{name} {each.amplitude:.3f} {each.frequency:.1f}"
        for name, each in newest.items()
        if each.amplitude > 0
    ]


if __name__ == "__main__":
    reader, newest = PredictionReader(sys.argv[1]), dict[str, HapticCommand]()
    while True:
        newest |= {passed.finger: passed.command for passed in reader.read()}
        print(*lines(newest), sep="\n", flush=True)
        time.sleep(INTERVAL)
