"""bHaptics over REST: ``python -m devices_tactophone.bhaptics RUN``, with ``python -m
bhaptics_http`` on the PC.

Each command plays one motor for 100 ms (``POST /haptic/dot``), so that a run that ends
is silent by then.
"""

import json
import sys
import time
import urllib.request

from tactophone.live.log.reader import PredictionReader

DURATION = 100
"""Milliseconds of one call, and how long a vibration outlasts its last command."""

INTERVAL = 0.05


def play(
    url: str, amplitudes: dict[str, float], *, device_type: int, motors: dict[str, int]
) -> None:
    """Play the amplitudes (0-1) of fingers on their motors."""
    levels = [
        {"index": motors[finger], "intensity": round(100 * min(max(level, 0.0), 1.0))}
        for finger, level in amplitudes.items()
        if finger in motors
    ]
    body = json.dumps(
        {"deviceType": device_type, "duration": DURATION, "motors": levels}
    ).encode()
    request = urllib.request.Request(
        f"{url}/haptic/dot", body, {"Content-Type": "application/json"}
    )
    urllib.request.urlopen(request, timeout=0.2).close()


if __name__ == "__main__":
    reader, levels = PredictionReader(sys.argv[1]), dict[str, float]()
    while True:
        levels |= {passed.finger: passed.command.amplitude for passed in reader.read()}
        if any(levels.values()):
            play(
                "http://localhost:15883",
                levels,
                device_type=int(sys.argv[2]),
                motors={"thumb": 0, "index": 1},
            )
        time.sleep(INTERVAL)
