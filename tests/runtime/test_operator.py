import time
from pathlib import Path

import numpy as np
import pytest

from tactophone.runtime import output_gate as guard
from tactophone.telemetry import Watcher
from tactophone.types import Touch

from ..models import write_tiny_model
from .line import Line, eventually

pytestmark = pytest.mark.realtime


@pytest.fixture
def line(tmp_path: Path) -> Line:
    return Line(tmp_path, write_tiny_model(tmp_path / "tiny.onnx", gain=1e3))


def test_a_rough_stroke_is_felt_and_its_end_too(line: Line) -> None:
    with line.both():
        assert eventually(lambda: line.amplitude() > 0.3)
        assert eventually(lambda: line.felt().ticks[-1]["touch"] == Touch.ROUGH)
        snapshot = line.felt()
        assert snapshot.state.link == "connected to robot"
        assert snapshot.state.faults == ()
        assert np.abs(snapshot.vibration).max() <= 0.5
        line.source.touching = False
        assert eventually(lambda: line.amplitude() == 0.0)


@pytest.mark.parametrize("first", ["robot", "operator"])
def test_either_side_may_start_first_die_and_come_back(line: Line, first: str) -> None:
    second = "operator" if first == "robot" else "robot"
    with getattr(line, first)():
        for _ in range(2):
            with getattr(line, second)():
                assert eventually(lambda: "operator" in (first, second) and line.amplitude() > 0.3, patience=8.0)
            if second == "robot":
                assert eventually(lambda: line.amplitude() == 0.0)


def test_a_robot_that_falls_silent_silences_the_finger_and_is_named(line: Line) -> None:
    with line.operator():
        with line.robot():
            assert eventually(lambda: line.amplitude() > 0.3)
        assert eventually(lambda: line.amplitude() == 0.0)
        assert eventually(lambda: any(fault.code == "link" for fault in line.felt().state.faults))


def test_the_emergency_stop_latches_until_somebody_arms(line: Line) -> None:
    with line.both() as operator:
        assert eventually(lambda: line.amplitude() > 0.3)
        operator.stop()
        assert eventually(lambda: line.amplitude() == 0.0)
        watcher = Watcher(line.names[1])
        watcher.ask("ceiling", 0.5)
        time.sleep(0.2)
        assert line.amplitude() == 0.0
        assert line.felt().state.muted_because == guard.EMERGENCY_STOP
        watcher.ask("arm")
        assert eventually(lambda: line.amplitude() > 0.3)
        assert line.felt().counters["emergency_stops"] == 1


def test_after_a_restart_nothing_is_felt_until_somebody_arms(line: Line) -> None:
    with line.robot(), line.operator(restarts=1):
        assert eventually(lambda: line.felt().ticks.size > 0 and line.felt().ticks[-1]["touch"] == Touch.ROUGH)
        assert line.amplitude() == 0.0
        assert line.felt().state.muted_because == guard.RESTARTED
        Watcher(line.names[1]).ask("arm")
        assert eventually(lambda: line.amplitude() > 0.3)


def test_a_page_lowers_the_ceiling_and_cannot_raise_it(line: Line) -> None:
    with line.both():
        assert eventually(lambda: line.amplitude() > 0.3)
        watcher = Watcher(line.names[1])
        watcher.ask("ceiling", 0.1)
        assert eventually(lambda: 0.05 < line.amplitude() <= 0.1)
        watcher.ask("ceiling", 0.9)
        assert eventually(lambda: line.felt().counters["requests_refused"] == 1)
        assert line.felt().state.ceiling == 0.1
        assert line.amplitude() <= 0.1


def test_threshold_and_profile_are_changed_only_to_what_there_is(line: Line) -> None:
    with line.both():
        watcher = Watcher(line.names[1])
        watcher.ask("threshold_dbfs", -3.0)
        watcher.ask("profile", text="telephone")
        assert eventually(lambda: line.felt().state.threshold_dbfs == -3.0)
        assert eventually(lambda: line.felt().counters["requests_refused"] == 1)
        assert eventually(lambda: line.amplitude() == 0.0)


def test_judging_on_the_robots_side_feels_the_same(tmp_path: Path) -> None:
    line = Line(tmp_path, write_tiny_model(tmp_path / "tiny.onnx", gain=1e3), "link.judge=true")
    with line.both():
        assert eventually(lambda: line.amplitude() > 0.3)
        assert line.felt().ticks[-1]["touch"] == Touch.ROUGH
        assert line.felt().gauges["bitrate_bps"] < 100_000


@pytest.mark.parametrize("gain", [np.inf, np.nan])
def test_a_model_that_answers_garbage_is_silence_and_a_count(tmp_path: Path, gain: float) -> None:
    line = Line(tmp_path, write_tiny_model(tmp_path / "tiny.onnx", gain=gain))
    with line.both():
        assert eventually(lambda: line.felt().counters["model_faults"] > 10)
        assert line.amplitude() == 0.0


def test_the_sound_itself_is_felt_and_stopped_like_any_vibration(tmp_path: Path) -> None:
    line = Line(tmp_path, write_tiny_model(tmp_path / "tiny.onnx", gain=1e3), "feel.profile=direct")
    with line.both() as operator:
        assert eventually(lambda: line.amplitude() > 0.3)
        assert line.felt().state.profiles == ("direct",)
        vibration = line.felt().vibration[-4800:]
        assert np.abs(vibration).max() <= 0.5
        assert np.abs(np.fft.rfft(vibration * np.hanning(4800))).argmax() * 10 == pytest.approx(400, abs=10)
        line.source.touching = False
        assert eventually(lambda: line.amplitude() == 0.0)
        line.source.touching = True
        assert eventually(lambda: line.amplitude() > 0.3)
        operator.stop()
        assert eventually(lambda: line.amplitude() == 0.0)
