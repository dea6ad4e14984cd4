"""Classify a recording: python examples/classify_wav.py finger.wav

Prints one line per change: the time, the touch and the roughness. Channel 0 is the
contact microphone, channel 1 (if there is one) the air microphone.
"""

import sys

from tactophone import Touch, open_recording


def main(path: str) -> None:
    """Print the predictions that differ from the one before, and what was corrected in
    the recording."""
    previous, recording = None, open_recording(path)
    for step in recording.steps():
        for prediction in step.predictions:
            if prediction.touch != previous:
                name = Touch(prediction.touch).name.lower()
                print(
                    f"{prediction.end:8.3f} s  {name:6}  roughness "
                    f"{prediction.roughness:.2f}"
                )
            previous = prediction.touch
    for note in recording.notes:
        print(f"note: {note}")


if __name__ == "__main__":
    main(*sys.argv[1:])
