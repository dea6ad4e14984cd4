"""Classify a recording: python examples/classify_wav.py finger.wav

Prints one line per change: the time, the touch and the roughness. Channel 0 is the contact microphone, channel 1 (if
there is one) the air microphone.
"""

import sys

from tactophone import FileSource, Touch, open_pipeline


def main(path: str) -> None:
    """Print the predictions that differ from the one before."""
    previous = None
    with FileSource(path) as source:
        pipeline = open_pipeline(sample_rate=source.sample_rate, channels=source.channels)
        for block in source:
            for prediction in pipeline.push(block).predictions:
                if prediction.touch != previous:
                    name = Touch(prediction.touch).name.lower()
                    print(f"{prediction.end:8.3f} s  {name:6}  roughness {prediction.roughness:.2f}")
                previous = prediction.touch


if __name__ == "__main__":
    main(*sys.argv[1:])
