"""How long a log becomes: a minute of two microphones as Opus, recorded in virtual
time.

``python -m tests.live.log.log_size [MODEL] [SECONDS]`` from the root of the repository;
about a minute.
"""

import sys
import tempfile
from pathlib import Path

import numpy as np

from tactophone.net.link.codec import Codec
from tactophone.signal.perception.models import model_path, open_touch_detector
from tests.live.log.recorded_run import RATE, record
from tests.sounds import blocks, strokes


def main() -> None:
    model, seconds = (
        sys.argv[1] if len(sys.argv) > 1 else "texture",
        int(sys.argv[2]) if len(sys.argv) > 2 else 60,
    )
    detector = open_touch_detector(model_path(model), sample_rate=RATE)
    codec = Codec("opus", channels=2, packet_size=240).for_bandwidth(detector.bandwidth)
    noise = 1e-3 * np.random.default_rng(0).standard_normal((seconds * RATE, 2))
    touched = np.resize(strokes()[:, 0], seconds * RATE)
    sound = (np.stack([touched, 0.1 * touched], axis=1) + noise).astype(np.float32)
    with tempfile.TemporaryDirectory() as folder:
        path = record(
            Path(folder) / "run.mcap",
            Path(model),
            codec=codec,
            sound=blocks(sound, 120),
        )
        size = path.stat().st_size
    sys.stdout.write(
        f"{model}, Opus at {codec.bitrate_bps // 1000} kbit/s: "
        f"{size / seconds * 600 / 1e6:.2f} MB in 10 minutes, "
        f"{codec.bitrate_bps * 600 / 8e6:.1f} of them sound\n"
    )


if __name__ == "__main__":
    main()
