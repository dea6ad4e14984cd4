"""A hand, live: both sides in this process, over real sockets."""

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from tactophone.core.hand import with_fingers
from tactophone.core.settings import change
from tactophone.core.types import LIVE_SAMPLE_RATE, AudioBlock
from tactophone.live.telemetry.layout import RunState
from tactophone.live.telemetry.watcher import Watcher
from tests.live.runtime.live_system import LiveSystem, Strokes, eventually
from tests.models import write_tiny_model

pytestmark = pytest.mark.realtime


class Hand(Strokes):
    """Strokes on thumb and middle finger; the index finger's contact microphone is
    dead."""

    channels = 6

    def __iter__(self) -> Iterator[AudioBlock]:
        random = np.random.default_rng(0)
        for block in Strokes.__iter__(self):
            contact, dead = block.samples[:, :1], np.zeros((block.size, 1), np.float32)
            air = 0.01 * random.standard_normal((block.size, 3)).astype(np.float32)
            parts = (contact, air[:, :1], dead, air[:, 1:2], contact, air[:, 2:])
            yield AudioBlock(
                np.concatenate(parts, axis=1), LIVE_SAMPLE_RATE, block.start
            )


@pytest.fixture
def system(tmp_path: Path) -> LiveSystem:
    system = LiveSystem(
        tmp_path,
        write_tiny_model(tmp_path / "tiny.onnx", gain=1e3),
        "link.packet_duration=0.0025",
    )
    checked = change(system.robot_settings, ["detector.check_microphones=true"])
    system.robot_settings = with_fingers(checked, "3")
    system.operator_settings = with_fingers(system.operator_settings, "3")
    system.source = Hand()
    return system


def peaks(watcher: Watcher) -> list[float]:
    """Largest of the newest 20 ms of each finger's vibration."""
    snapshots = [watcher.snapshot(finger=finger) for finger in range(watcher.fingers)]
    return [
        float(np.abs(snapshot.vibration[-960:]).max(initial=0.0))
        for snapshot in snapshots
    ]


def state(watcher: Watcher) -> RunState:
    return watcher.snapshot().state


def test_a_finger_whose_microphone_fails_is_silent_and_the_others_go_on(
    system: LiveSystem,
) -> None:
    with system.both():
        watcher = Watcher(system.names[1])
        assert watcher.fingers == 3
        assert eventually(lambda: min(peaks(watcher)[0], peaks(watcher)[2]) > 0.3)
        robot = Watcher(system.names[0])
        assert eventually(
            lambda: any(
                fault.code == "index-contact-dead" for fault in state(robot).faults
            )
        )
        assert peaks(watcher)[1] == 0.0
        assert [finger.name for finger in state(watcher).fingers] == [
            "thumb",
            "index",
            "middle",
        ]


def test_a_finger_is_muted_alone_and_an_emergency_stop_is_for_all(
    system: LiveSystem,
) -> None:
    with system.both() as operator:
        watcher = Watcher(system.names[1])
        assert eventually(lambda: min(peaks(watcher)[0], peaks(watcher)[2]) > 0.3)
        watcher.ask("mute", finger=0)
        assert eventually(lambda: peaks(watcher)[0] == 0.0 and peaks(watcher)[2] > 0.3)
        assert eventually(
            lambda: (
                [finger.armed for finger in state(watcher).fingers]
                == [False, True, True]
            )
        )
        operator.stop()
        assert eventually(lambda: max(peaks(watcher)) == 0.0)
        assert eventually(
            lambda: not any(finger.armed for finger in state(watcher).fingers)
        )
        watcher.ask("arm", finger=2)
        assert eventually(lambda: peaks(watcher)[0] == 0.0 and peaks(watcher)[2] > 0.3)


def test_the_watchdog_sees_the_finger_that_vibrates_most_not_the_last(
    system: LiveSystem,
) -> None:
    """A stalled hand is late after 50 ms while any finger vibrates, and after 2 s while
    none does."""
    with system.both():
        watcher = Watcher(system.names[1])
        assert eventually(lambda: min(peaks(watcher)[0], peaks(watcher)[2]) > 0.3)
        watcher.ask("ceiling", 0.05, finger=2)
        assert eventually(lambda: 0.0 < peaks(watcher)[2] <= 0.05)
        assert eventually(lambda: watcher.pulse().amplitude > 0.3)
        watcher.ask("mute", finger=2)
        assert eventually(lambda: peaks(watcher)[2] == 0.0)
        assert eventually(lambda: watcher.pulse().amplitude > 0.3)
        watcher.ask("mute")
        assert eventually(lambda: watcher.pulse().amplitude == 0.0)


def test_an_operator_with_another_number_of_fingers_says_so_at_both_ends(
    system: LiveSystem,
) -> None:
    system.operator_settings = replace(with_fingers(system.operator_settings, "2"))
    with system.both():
        operator, robot = Watcher(system.names[1]), Watcher(system.names[0])

        def faults_of(watcher: Watcher) -> str:
            return " ".join(fault.text for fault in state(watcher).faults)

        assert eventually(
            lambda: "the robot has 3 fingers, this operator 2" in faults_of(operator)
        )
        assert eventually(
            lambda: (
                "this operator 2: give both ends the same --fingers" in faults_of(robot)
            )
        )
