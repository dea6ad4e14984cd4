"""Be called back by live sound: python examples/live_callback.py [SOURCE] [SECONDS]

SOURCE is what `--source` takes: finger (simulated), jack, portaudio:DEVICE,
file:RECORDING. The callback runs in a thread of its own, a block at a time; keep it
short, or the sound waits.
"""

import sys
import time

import tactophone


def print_step(step: tactophone.PipelineStep) -> None:
    """Print what a block led to."""
    for prediction in step.predictions:
        print(
            f"{prediction.end:8.3f} s  {prediction.touch.name.lower():6}  "
            f"{prediction.roughness:.2f}"
        )


if __name__ == "__main__":
    source, seconds = (
        sys.argv[1] if len(sys.argv) > 1 else "finger",
        float((sys.argv[2:] or ["5"])[0]),
    )
    with tactophone.open_live(source).start(print_step):
        time.sleep(seconds)
