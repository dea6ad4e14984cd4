import gc
import os
import sys
import threading
from pathlib import Path

import pytest

from tactophone.live.runtime.priority import (
    AWAKE_WITHIN,
    COLLECTION_INTERVAL,
    collect_garbage,
    cores_awake,
    follow_period,
    prepare_passing,
    prioritize_thread,
    settle,
)


@pytest.mark.slow
def test_settling_hides_everything_from_the_collector() -> None:
    before = sys.getswitchinterval()
    settle()
    try:
        assert gc.get_freeze_count() > 1000
    finally:
        gc.unfreeze()
        sys.setswitchinterval(before)


@pytest.mark.slow
def test_garbage_is_collected_now_and_then_and_not_at_each_call() -> None:
    before = gc.get_stats()[2]["collections"]
    assert collect_garbage(0.0, 0.9 * COLLECTION_INTERVAL) == 0.0
    assert collect_garbage(0.0, COLLECTION_INTERVAL) == COLLECTION_INTERVAL
    assert (
        collect_garbage(COLLECTION_INTERVAL, 1.9 * COLLECTION_INTERVAL)
        == COLLECTION_INTERVAL
    )
    assert gc.get_stats()[2]["collections"] == before + 1


def test_a_refused_priority_is_one_sentence_with_a_remedy(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def refuse(*_: object) -> None:
        raise PermissionError

    monkeypatch.setattr(os, "sched_setscheduler", refuse)
    assert "limits.d" in prioritize_thread(50)


def test_only_the_calling_thread_is_prioritized() -> None:
    warnings: list[str] = []
    thread = threading.Thread(target=lambda: warnings.append(prioritize_thread(1)))
    thread.start()
    thread.join()
    assert warnings[0] == "" or "no right" in warnings[0]
    assert os.sched_getscheduler(0) == os.SCHED_OTHER


def test_priority_zero_requests_nothing() -> None:
    assert prioritize_thread(0) == ""


@pytest.mark.slow
def test_the_callback_waits_for_the_interpreter_under_a_period_of_32_samples() -> None:
    before = sys.getswitchinterval()
    settle()
    try:
        assert sys.getswitchinterval() < 32 / 48_000 / 4
    finally:
        sys.setswitchinterval(before)


@pytest.mark.parametrize(("wanted", "given"), [(58, [1]), (1, [1]), (0, [])])
def test_a_call_waits_for_no_other_program_but_for_the_sound(
    wanted: int, given: list[int], monkeypatch: pytest.MonkeyPatch
) -> None:
    asked: list[int] = []
    monkeypatch.setattr(
        os,
        "sched_setscheduler",
        lambda pid, policy, param: asked.append(param.sched_priority),
    )
    before = sys.getswitchinterval()
    prepare_passing(wanted)
    gc.unfreeze()
    sys.setswitchinterval(before)
    assert asked == given


@pytest.mark.parametrize(
    ("samples", "milliseconds"),
    [(0, 0.1), (16, 0.1), (32, 0.133), (64, 0.267), (128, 0.533), (512, 1.0)],
)
def test_threads_take_turns_five_times_a_period(
    samples: int, milliseconds: float
) -> None:
    before = sys.getswitchinterval()
    try:
        follow_period(samples / 48_000)
        assert 1e3 * sys.getswitchinterval() == pytest.approx(milliseconds, abs=0.01)
    finally:
        sys.setswitchinterval(before)


def test_the_cores_are_held_awake_where_the_system_permits_it(tmp_path: Path) -> None:
    file = tmp_path / "latency"
    file.touch()
    with cores_awake(file) as held:
        assert held
        assert int.from_bytes(file.read_bytes(), sys.byteorder) == AWAKE_WITHIN
        assert any(
            os.readlink(each) == str(file)
            for each in Path("/proc/self/fd").iterdir()
            if each.is_symlink()
        )
    with cores_awake(tmp_path / "nothing" / "here") as held:
        assert not held
