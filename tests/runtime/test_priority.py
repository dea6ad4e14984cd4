import gc
import os
import sys
import threading

import pytest

from tactophone.runtime.priority import (
    COLLECTION_INTERVAL,
    GarbageCollection,
    prioritize_thread,
    share_interpreter,
)


def test_settling_hides_everything_from_the_collector() -> None:
    GarbageCollection(0.0)
    try:
        assert gc.get_freeze_count() > 1000
    finally:
        gc.unfreeze()


def test_garbage_is_collected_now_and_then_and_not_at_each_call() -> None:
    garbage = GarbageCollection(0.0)
    try:
        before = gc.get_stats()[2]["collections"]
        assert not garbage.collect(0.9 * COLLECTION_INTERVAL)
        assert garbage.collect(COLLECTION_INTERVAL)
        assert not garbage.collect(1.9 * COLLECTION_INTERVAL)
        assert gc.get_stats()[2]["collections"] == before + 1
    finally:
        gc.unfreeze()


def test_a_refused_priority_is_one_sentence_with_a_remedy(monkeypatch: pytest.MonkeyPatch) -> None:
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


def test_the_callback_waits_for_the_interpreter_less_than_a_period_of_32_samples() -> None:
    before = sys.getswitchinterval()
    share_interpreter()
    try:
        assert sys.getswitchinterval() < 32 / 48_000 / 4
    finally:
        sys.setswitchinterval(before)
