"""Render predictions in your own way: python examples/custom_profile.py finger.wav

A rendering profile maps a prediction to a command. This one keeps 80 Hz and lets only
the amplitude follow the roughness; the pipeline's limits still apply to whatever it
returns.
"""

import sys
from dataclasses import dataclass

from tactophone import FileSource, HapticCommand, Prediction, Touch, open_pipeline


@dataclass(frozen=True, slots=True)
class Strength:
    """80 Hz, from a quarter of full drive (smooth) to full drive (rough)."""

    name: str = "strength"

    def command(self, prediction: Prediction) -> HapticCommand:
        """Return the command for a prediction."""
        contact = prediction.touch is not Touch.NONE
        amplitude = 0.25 + 0.75 * prediction.roughness if contact else 0.0
        return HapticCommand(amplitude, 80.0, prediction.end)


def main(path: str) -> None:
    """Print the commands for a recording."""
    with FileSource(path) as source:
        pipeline = open_pipeline(
            sample_rate=source.sample_rate, channels=source.channels
        )
        pipeline.profile = Strength()
        for block in source:
            for command in pipeline.push(block).commands:
                print(
                    f"{command.time:8.3f} s  {command.frequency:.0f} Hz  "
                    f"{command.amplitude:.2f}"
                )


if __name__ == "__main__":
    main(*sys.argv[1:])
