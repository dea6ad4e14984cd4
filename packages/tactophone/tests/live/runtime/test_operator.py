import signal
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from tactophone.core.types import Touch
from tactophone.live.audio.actuator import Actuator
from tactophone.live.runtime.operator import LONGEST_CALL, Operator
from tactophone.live.runtime.output_gate import EMERGENCY_STOP, RESTARTED
from tactophone.live.runtime.supervisor import ProcessInfo
from tactophone.live.telemetry.layout import RunState
from tactophone.live.telemetry.memory import folder as memory_folder
from tactophone.live.telemetry.watcher import Watcher
from tactophone.live.telemetry.writer import Telemetry
from tactophone.net.endpoints import EventStep, OperatorEndpoint
from tactophone.net.link.send import Datagrams
from tests.models import write_tiny_model

from .live_system import LiveSystem, eventually

pytestmark = pytest.mark.realtime


@pytest.fixture
def system(tmp_path: Path) -> LiveSystem:
    return LiveSystem(tmp_path, write_tiny_model(tmp_path / "tiny.onnx", gain=1e3))


def test_a_rough_stroke_is_rendered_and_its_end_too(system: LiveSystem) -> None:
    with system.both():
        assert eventually(lambda: system.amplitude() > 0.3)
        assert eventually(lambda: system.snapshot().steps[-1]["touch"] == Touch.ROUGH)
        snapshot = system.snapshot()
        assert snapshot.state.link == "connected to robot"
        assert snapshot.state.faults == ()
        assert np.abs(snapshot.vibration).max() <= 0.5
        system.source.touching = False
        assert eventually(lambda: system.amplitude() == 0.0)


@pytest.mark.parametrize("first", ["robot", "operator"])
def test_either_side_may_start_first_die_and_come_back(
    system: LiveSystem, first: str
) -> None:
    second = "operator" if first == "robot" else "robot"
    with getattr(system, first)():
        for _ in range(2):
            with getattr(system, second)():
                assert eventually(
                    lambda: "operator" in (first, second) and system.amplitude() > 0.3,
                    timeout=8.0,
                )
            if second == "robot":
                assert eventually(lambda: system.amplitude() == 0.0)


def test_at_the_end_silence_does_not_wait_for_the_network(
    system: LiveSystem, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The network's thread may have much to do when the run ends, and goes on with
    commands."""
    amplitudes: list[float] = []
    lingers = threading.Event()
    with system.both() as operator:
        assert eventually(lambda: system.amplitude() > 0.3)
        receive = OperatorEndpoint.receive

        def linger(
            endpoint: OperatorEndpoint, datagrams: Datagrams, *, now: float
        ) -> Iterator[EventStep]:
            steps = list(receive(endpoint, datagrams, now=now))
            newest = next((step for _, step in steps if step and step.commands), None)
            yield from steps
            while newest and len(amplitudes) < 30:
                lingers.set()
                yield steps[-1][0], newest
                time.sleep(0.01)
                if operator.ended.is_set():
                    amplitudes.append(system.amplitude())

        monkeypatch.setattr(OperatorEndpoint, "receive", linger)
        assert lingers.wait(5.0)
    assert len(amplitudes) == 30
    assert amplitudes[-1] == 0.0


def test_a_robot_that_falls_silent_silences_the_finger_and_is_reported(
    system: LiveSystem,
) -> None:
    with system.operator():
        with system.robot():
            assert eventually(lambda: system.amplitude() > 0.3)
        assert eventually(lambda: system.amplitude() == 0.0)
        assert eventually(
            lambda: any(
                fault.code == "link" for fault in system.snapshot().state.faults
            ),
            timeout=2 * LONGEST_CALL,
        )


def test_the_emergency_stop_latches_until_armed(system: LiveSystem) -> None:
    with system.both() as operator:
        assert eventually(lambda: system.amplitude() > 0.3)
        operator.stop()
        assert eventually(lambda: system.amplitude() == 0.0)
        watcher = Watcher(system.names[1])
        watcher.ask("ceiling", 0.5)
        time.sleep(0.2)
        assert system.amplitude() == 0.0
        assert system.snapshot().state.muted_because == EMERGENCY_STOP
        watcher.ask("arm")
        assert eventually(lambda: system.amplitude() > 0.3)
        assert system.snapshot().counters["emergency_stops"] == 1


def test_a_stop_by_a_signal_is_seen_by_whoever_holds_resume_stopped_or_not(
    system: LiveSystem,
) -> None:
    """Of a run that was stopped already, Resume released a Ctrl-Z during the hold."""
    with system.operator() as operator:
        watcher = Watcher(system.names[1])
        for _ in range(2):
            seen = watcher.silenced
            operator.stop()
            assert eventually(lambda seen=seen: watcher.silenced > seen)
        assert eventually(lambda: system.snapshot().counters["emergency_stops"] == 1)


def test_a_stop_while_a_lost_device_comes_back_is_obeyed_before_it_renders(
    system: LiveSystem, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It vibrated for some periods more, seconds after the stop."""
    silent: list[bool] = []
    with system.both() as operator:
        assert eventually(lambda: system.amplitude() > 0.3)
        watcher = Watcher(system.names[1])
        device = operator._actuator.device

        def come_back() -> None:
            """Wait for a server, and render before the mailbox is read."""
            if not silent:
                watcher.ask("stop")
                silent.append(eventually(lambda: system.amplitude() == 0.0))

        monkeypatch.setattr(type(device), "lost", True)
        monkeypatch.setattr(device, "revive", come_back)
        assert eventually(lambda: bool(silent))
    assert silent == [True]


def test_what_was_asked_of_a_process_that_stood_still_is_obeyed_by_its_successor(
    system: LiveSystem,
) -> None:
    """A ceiling that was lowered meanwhile was forgotten."""
    name = system.names[1]
    with Telemetry(name) as telemetry:
        telemetry.update(RunState(role="operator"), now=time.monotonic())
        watcher = Watcher(name)
        for action, value in (
            ("ceiling", 0.05),
            ("lower_ceiling", 0.2),
            ("output_level", 0.5),
            ("stop", 0.0),
            ("arm", 0.0),
        ):
            watcher.ask(action, value)
        left = memory_folder().joinpath(f"tactophone-{name}")
        killed = left.read_bytes()
    # Without a process: that of a killed one is not there any more.
    left.write_bytes(killed[:8] + bytes(8) + killed[16:])
    with system.operator(restarts=1) as operator:
        finger = operator._fingers[0].state()
    assert (finger.ceiling, finger.output_level) == (0.05, 0.5)
    assert finger.muted_because == EMERGENCY_STOP


def test_who_stops_a_run_finds_it_before_its_device_is_open(
    system: LiveSystem, monkeypatch: pytest.MonkeyPatch
) -> None:
    """`tactophone stop` passed over a run that vibrated already."""
    found: list[tuple[str, str, float]] = []
    enter = Actuator.__enter__

    def open_later(actuator: Actuator) -> Actuator:
        watcher = Watcher(system.names[1])
        state = watcher.state()
        found.append((state.role, state.muted_because, watcher.pulse().beat))
        watcher.ask("stop")
        return enter(actuator)

    monkeypatch.setattr(Actuator, "__enter__", open_later)
    with system.operator():
        assert eventually(
            lambda: system.snapshot().state.muted_because == EMERGENCY_STOP
        )
    assert found == [("operator", "starting", 0.0)]


def test_a_stop_during_the_start_waits_for_the_device_and_comes_before_vibration(
    system: LiveSystem, monkeypatch: pytest.MonkeyPatch
) -> None:
    """JACK's library took the signal for a lost server, and the run did not start."""
    operator = Operator(system.operator_settings, ProcessInfo(system.names[1]))
    did: list[str] = []
    begin, start, stop = (
        type(operator._actuator).__enter__,
        operator._start,
        operator.stop,
    )
    for owner, name, work in (
        (type(operator._actuator), "__enter__", begin),
        (operator, "_start", start),
        (operator, "stop", stop),
    ):

        def noted(*given: Any, name: str = name, work: Any = work) -> Any:
            did.append(name)
            return work(*given)

        monkeypatch.setattr(owner, name, noted)
    before = signal.signal(signal.SIGUSR1, lambda *_: operator.stop())
    blocked = signal.pthread_sigmask(signal.SIG_BLOCK, {signal.SIGUSR1})
    try:
        signal.pthread_kill(threading.get_ident(), signal.SIGUSR1)
        with operator:
            assert not operator._fingers[0].gate.armed
    finally:
        signal.pthread_sigmask(signal.SIG_SETMASK, blocked)
        signal.signal(signal.SIGUSR1, before)
    assert did == ["__enter__", "stop", "_start"]


def test_after_a_restart_nothing_is_rendered_until_armed(system: LiveSystem) -> None:
    with system.robot(), system.operator(restarts=1):
        assert eventually(
            lambda: (
                system.snapshot().steps.size > 0
                and system.snapshot().steps[-1]["touch"] == Touch.ROUGH
            )
        )
        assert system.amplitude() == 0.0
        assert system.snapshot().state.muted_because == RESTARTED
        Watcher(system.names[1]).ask("arm")
        assert eventually(lambda: system.amplitude() > 0.3)


def test_a_page_lowers_the_ceiling_and_cannot_raise_it(system: LiveSystem) -> None:
    with system.both():
        assert eventually(lambda: system.amplitude() > 0.3)
        watcher = Watcher(system.names[1])
        watcher.ask("ceiling", 0.1)
        assert eventually(lambda: 0.05 < system.amplitude() <= 0.1)
        watcher.ask("ceiling", 0.9)
        assert eventually(lambda: system.snapshot().counters["requests_refused"] == 1)
        assert system.snapshot().state.fingers[0].ceiling == 0.1
        assert system.amplitude() <= 0.1


def test_an_operator_without_a_robot_buzzes_when_asked_and_not_while_muted(
    system: LiveSystem,
) -> None:
    with system.operator():
        assert eventually(lambda: system.snapshot().state.fingers[0].can_buzz)
        watcher = Watcher(system.names[1])
        watcher.ask("buzz")
        assert eventually(lambda: system.amplitude() > 0.3)
        assert eventually(lambda: system.amplitude() == 0.0)
        assert np.abs(system.snapshot().vibration).max() <= 0.5
        watcher.ask("mute")
        assert eventually(lambda: not system.snapshot().state.armed)
        watcher.ask("buzz")
        assert eventually(lambda: system.snapshot().counters["requests_refused"] == 1)
        assert system.amplitude() == 0.0


def test_threshold_and_profile_are_changed_only_to_what_there_is(
    system: LiveSystem,
) -> None:
    with system.both():
        watcher = Watcher(system.names[1])
        watcher.ask("threshold_dbfs", -3.0)
        watcher.ask("profile", text="telephone")
        assert eventually(
            lambda: system.snapshot().state.fingers[0].threshold_dbfs == -3.0
        )
        assert eventually(lambda: system.snapshot().counters["requests_refused"] == 1)
        assert eventually(lambda: system.amplitude() == 0.0)


def test_predictions_made_on_the_robot_render_the_same(tmp_path: Path) -> None:
    system = LiveSystem(
        tmp_path,
        write_tiny_model(tmp_path / "tiny.onnx", gain=1e3),
        "link.send_predictions=true",
    )
    with system.both():
        assert eventually(lambda: system.amplitude() > 0.3)
        assert system.snapshot().steps[-1]["touch"] == Touch.ROUGH
        assert system.snapshot().gauges["bitrate_bps"] < 100_000


def test_a_model_that_outputs_invalid_numbers_is_silence_and_a_count(
    tmp_path: Path,
) -> None:
    # A file whose weights are not finite is refused. These are, but their sums are not.
    system = LiveSystem(tmp_path, write_tiny_model(tmp_path / "tiny.onnx", gain=3e38))
    with system.both():
        assert eventually(lambda: system.snapshot().counters["model_faults"] > 10)
        assert system.amplitude() == 0.0


def test_the_sound_itself_is_rendered_and_stopped_like_any_vibration(
    tmp_path: Path,
) -> None:
    system = LiveSystem(
        tmp_path,
        write_tiny_model(tmp_path / "tiny.onnx", gain=1e3),
        "rendering.profile=direct",
    )
    with system.both() as operator:
        assert eventually(lambda: system.amplitude() > 0.3)
        assert system.snapshot().state.profiles == ("direct",)
        vibration = system.snapshot().vibration[-4800:]
        assert np.abs(vibration).max() <= 0.5
        assert np.abs(
            np.fft.rfft(vibration * np.hanning(4800))
        ).argmax() * 10 == pytest.approx(400, abs=10)
        system.source.touching = False
        assert eventually(lambda: system.amplitude() == 0.0)
        system.source.touching = True
        assert eventually(lambda: system.amplitude() > 0.3)
        operator.stop()
        assert eventually(lambda: system.amplitude() == 0.0)


def test_a_one_channel_robot_and_a_two_channel_model_say_why_and_do_not_restart(
    tmp_path: Path,
) -> None:
    system = LiveSystem(tmp_path, Path("paper"))
    system.source.channels = 1  # type: ignore[misc]
    with system.both() as operator:
        assert eventually(
            lambda: any(
                fault.code == "refused" for fault in system.snapshot().state.faults
            )
        )
        robot = Watcher(system.names[0])
        assert eventually(
            lambda: any(
                "choose a one-channel" in f.text for f in robot.snapshot().state.faults
            )
        )
        assert operator.failure is None
        assert not operator.ended.is_set()
