import numpy as np

from tactophone.simulation.content.demonstration import demonstration
from tactophone.simulation.content.render_store import tell


def test_the_finger_strokes_smooth_then_rough_and_slips_off() -> None:
    finger = demonstration()
    things = []
    for _ in finger:
        things.append(finger.truth.thing)
    segments, _ = tell(np.concatenate(things), finger.scene)
    touched = [segment.word for segment in segments if segment.word != "none"]
    assert touched[0] == "smooth"
    assert touched[-2:] == ["rough", "contact"]
    assert 8 < segments[-1].end < 16
