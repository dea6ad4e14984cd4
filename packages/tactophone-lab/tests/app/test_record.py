"""A notebook records an object as the verb does: by one function that returns its
takes."""

from pathlib import Path

import pytest

from tactophone.core.settings import Settings, change
from tactophone.core.types import Touch
from tactophone.signal.perception.health import Reference
from tactophone_lab.app.record import record_object
from tactophone_lab.recording.take_recorder import RecordedObject, SessionPlan
from tactophone_lab.simulation.takes import TAKES

FINGER = change(Settings(), ["capture.source=finger"])


@pytest.mark.slow
def test_a_simulated_finger_records_the_takes_that_the_folder_lacks(
    tmp_path: Path,
) -> None:
    target = RecordedObject("honed slate", Touch.ROUGH, session="monday")
    plan = SessionPlan(tmp_path, Reference(), tuple(TAKES)[:2], duration=1.0)
    said: list[str] = []
    stages = set()
    takes = record_object(
        FINGER,
        target,
        plan,
        follow=lambda recorder, _: stages.add(recorder.protocol.stage),
        report=said.append,
    )
    assert [take.take for take in takes] == [take.name for take in plan.takes]
    assert all(take.path.is_file() for take in takes)
    assert said == ["2 takes to record"]
    assert len(stages) > 2
    assert record_object(FINGER, target, plan, report=said.append) == []
    assert said[-1] == "all takes are recorded already"
