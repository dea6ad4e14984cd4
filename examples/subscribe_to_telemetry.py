"""Watch a running process: python examples/subscribe_to_telemetry.py receive [SECONDS]

Start `tactophone receive` (or `loopback`, `demo`) in another terminal first; its name
is the verb, or what --name says. Reading never slows the watched process down.
"""

import sys
import time

from tactophone import Watcher


def main(name: str, seconds: str = "10") -> None:
    """Print the newest prediction and the packet counts, five times a second."""
    watcher = Watcher(name)
    deadline = time.monotonic() + float(seconds)
    while time.monotonic() < deadline:
        snapshot = watcher.snapshot()
        received, lost = (
            snapshot.counters["packets_received"],
            snapshot.counters["packets_lost"],
        )
        roughness = (
            snapshot.steps[-1]["roughness"] if len(snapshot.steps) else float("nan")
        )
        print(f"roughness {roughness:.2f}  {received} packets received, {lost} lost")
        time.sleep(0.2)


if __name__ == "__main__":
    main(*sys.argv[1:])
