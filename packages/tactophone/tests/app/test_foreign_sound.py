"""Real contact sound of no finger: the detector says that it does not know it."""

from pathlib import Path

from tactophone import Touch, open_recording

SCREWS = Path(__file__).parents[4] / "tests" / "data" / "ramp" / "screws.flac"


def test_screws_on_a_ramp_are_unknown_and_never_felt_as_rough() -> None:
    recording = open_recording(SCREWS)
    predictions = [each for step in recording.steps() for each in step.predictions]
    touching = [each for each in predictions if each.touch is not Touch.NONE]
    assert touching
    assert all(each.unknown for each in touching)
    assert not any(each.touch is Touch.ROUGH for each in touching)
