import signal
import threading
import time
from pathlib import Path
from types import SimpleNamespace
from typing import cast
from uuid import uuid4

import numpy as np
import pytest

from tactophone.cli import output
from tactophone.cli.console import Keys, _ConsoleView, follow
from tactophone.core.types import (
    AudioBlock,
    HapticCommand,
    PipelineStep,
    Prediction,
    Touch,
)
from tactophone.live.runtime.supervisor import Supervisor
from tactophone.live.telemetry.layout import Fault, FingerState, RunState
from tactophone.live.telemetry.writer import Telemetry

NAME = f"test-console-{uuid4().hex[:8]}"
"""Of the run: another in each process, as tests may run side by side."""


def test_the_terminal_says_why_there_is_no_link_once(
    capsys: pytest.CaptureFixture[str],
) -> None:
    refused = Fault(
        "link", "no operator at hand.local:48470 yet: certificate verify failed"
    )
    with Telemetry(NAME) as telemetry:
        view = _ConsoleView(NAME)
        for state in (
            RunState(link=""),
            RunState(link="calling", faults=(refused,)),
            RunState(link="calling", faults=(refused,)),
        ):
            telemetry.update(state, now=time.monotonic())
            view.update()
    assert capsys.readouterr().err.splitlines() == [f"! {refused.text}", "calling"]


def test_the_terminal_says_when_a_fault_is_over(
    capsys: pytest.CaptureFixture[str],
) -> None:
    gone = Fault("actuator", "the JACK server is gone: start it again")
    late = Fault("actuator", "the JACK server stands still")
    other = Fault("link", "no robot is connected: refused")
    with Telemetry(NAME) as telemetry:
        view = _ConsoleView(NAME)
        for faults in ((gone, other), (late, other), (other,), (other,)):
            telemetry.update(RunState(faults=faults), now=time.monotonic())
            view.update()
    assert capsys.readouterr().err.splitlines() == [
        f"! {gone.text}",
        f"! {other.text}",
        f"! {late.text}",
        f"over: {late.text}",
    ]


def test_the_line_shows_the_last_seconds_of_vibration_by_height_and_class() -> None:
    block = AudioBlock(np.zeros((480, 2), np.float32), 48_000)
    with Telemetry("test-strip") as telemetry:
        view = _ConsoleView("test-strip")
        for touch, amplitude in (
            (Touch.SMOOTH, 0.05),
            (Touch.ROUGH, 0.5),
            (Touch.NONE, 0.0),
        ):
            predicted = Prediction(
                (0.0, 0.5, 0.5), touch, 0.5, -30.0, start=0.0, end=0.01
            )
            command = HapticCommand(amplitude, 60.0, 0.01)
            telemetry.publish(
                PipelineStep(block, (predicted,), (command,)), now=time.monotonic()
            )
            telemetry.update(RunState(role="operator"), now=time.monotonic())
            view.update()
        strip, figures = view.line().split("\n")
    assert (strip.plain[-3:], len(strip)) == ("▂█·", 60)
    assert [span.style for span in strip.spans[-3:]] == ["blue", "red", "dim"]
    assert figures.plain.startswith("contact")


HOSTILE = "0.1.0[/x] [link=http://x]y[/] \x1b]0;title\x07\x1b[2J\x9b2J\r" + "A" * 700


def test_a_run_shorter_than_a_look_is_looked_at_once() -> None:
    side = SimpleNamespace(running=True, restarts=0, wait=lambda _: False)
    with Telemetry("test-short") as telemetry:
        telemetry.update(RunState(role="robot"), now=time.monotonic())
        outcome = follow([cast(Supervisor, side)], Keys("test-short"), duration=1e-300)
    assert outcome.last is not None
    assert outcome.last.state.role == "robot"


@pytest.mark.parametrize("role", ["operator", "robot"])
def test_ctrl_z_stops_the_vibration_and_says_what_to_do(
    role: str, capsys: pytest.CaptureFixture[str]
) -> None:
    stops: list[str] = []

    def wait(_: float) -> bool:
        assert signal.getsignal(signal.SIGTSTP) is not signal.SIG_DFL
        signal.raise_signal(signal.SIGTSTP)
        return False

    side = SimpleNamespace(
        running=True, restarts=0, wait=wait, stop_emergency=lambda: stops.append(role)
    )
    with Telemetry(NAME) as telemetry:
        telemetry.update(RunState(role=role), now=time.monotonic())
        while len(stops) < 2:
            follow([cast(Supervisor, side)], Keys(NAME), duration=0.5)
    said = capsys.readouterr().err
    assert "Ctrl-Z does not suspend a run: q ends it" in said
    assert ("the vibration is stopped" in said) == (role == "operator")


@pytest.mark.parametrize("ended_by", ["signal", "duration"])
def test_a_run_that_ends_while_its_terminal_stands_still_stops_vibrating(
    ended_by: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    stopped = threading.Event()
    waited: list[bool] = []

    def write(_: _ConsoleView) -> None:
        """Stand still as a terminal does, until the vibration is stopped."""
        if not waited and ended_by == "signal":
            signal.raise_signal(signal.SIGTERM)
        waited.append(stopped.wait(20.0))

    monkeypatch.setattr(_ConsoleView, "update", write)
    side = SimpleNamespace(
        running=True, restarts=0, wait=lambda _: False, stop_emergency=stopped.set
    )
    follow(
        [cast(Supervisor, side)],
        Keys(NAME),
        duration=0.01 if ended_by == "duration" else 0.0,
    )
    assert waited == [True]


def test_every_fault_and_field_is_printed_as_text_whatever_the_other_end_named_itself(
    capsys: pytest.CaptureFixture[str],
) -> None:
    """The other end's version and its goodbye, names of devices, runs and surfaces: all
    reach these sinks."""
    faults = tuple(
        Fault(code, f"{code}: {HOSTILE}")
        for code in ("link", "peer", "source", "output", "version")
    )
    fingers = (
        FingerState(name=HOSTILE, muted_because=HOSTILE, profile=HOSTILE, armed=False),
    )
    with Telemetry("test-hostile-text") as telemetry:
        view = _ConsoleView("test-hostile-text")
        state = RunState(
            "operator",
            link=HOSTILE,
            source=HOSTILE,
            output=HOSTILE,
            faults=faults,
            fingers=fingers,
        )
        telemetry.update(state, now=time.monotonic())
        view.update()
    output.note(HOSTILE)
    output.warn(HOSTILE)
    output.print_error(HOSTILE)
    row = {
        "surface": HOSTILE,
        HOSTILE: Path(HOSTILE),
        "styled": output.styled("red", HOSTILE, HOSTILE),
    }
    output.show(
        {"name": HOSTILE},
        [HOSTILE, [row], output.listing([(HOSTILE, HOSTILE)])],
        as_json=False,
    )
    output.show({"name": HOSTILE}, as_json=True)
    out, err = capsys.readouterr()
    assert err.count("[/x] [link=http://x]") == 5 + 2 + 3
    assert all(char.isprintable() or char == "\n" for char in out + err)
    assert all(len(line) <= 500 for line in err.splitlines()[:7])


def test_of_a_message_too_long_to_read_both_ends_are_printed(
    capsys: pytest.CaptureFixture[str],
) -> None:
    output.print_error(f"model = {'A' * 3_000_000}; choose another")
    output.warn(f"model = {'A' * 3_000_000}; choose another")
    for line in capsys.readouterr().err.splitlines():
        assert len(line) < output.MOST_LETTERS + 100
        assert "model = AAA" in line
        assert line.endswith("AAA; choose another")


@pytest.mark.parametrize("error", [BrokenPipeError(), SystemExit(1), OSError(28)])
def test_a_line_that_nobody_can_read_ends_the_main_thread_alone(
    error: BaseException, monkeypatch: pytest.MonkeyPatch
) -> None:
    """It ended the watchdog's thread, and without a word."""

    def fail(*_: object, **__: object) -> None:
        raise error

    monkeypatch.setattr(output, "log", lambda: SimpleNamespace(print=fail))
    went_on = threading.Event()
    thread = threading.Thread(target=lambda: (output.warn("late"), went_on.set()))
    thread.start()
    thread.join()
    assert went_on.is_set()
    with pytest.raises(type(error)):
        output.note("late")
