"""A terminal that stands still, or is gone, keeps the watchdog from nothing."""

import threading
from types import SimpleNamespace
from typing import Any, cast

import pytest

from tactophone.core.settings import Settings
from tactophone.live.runtime import supervisor
from tactophone.live.runtime.supervisor import Supervisor
from tactophone.live.runtime.watchdog import Verdict


def side(report: Any) -> Supervisor:
    settings = Settings()
    made = Supervisor(cast(Any, None), settings, name="test-unread", report=report)
    made._speaker.start()
    return made


def test_the_watchdog_waits_for_no_terminal(monkeypatch: pytest.MonkeyPatch) -> None:
    read = threading.Event()
    lines: list[str] = []
    watched = side(lambda line: (read.wait(), lines.append(line)))
    monkeypatch.setattr(supervisor, "disconnect_from_jack", lambda _: True)
    verdicts = iter((Verdict.LATE, Verdict.RESUMED, Verdict.LATE, Verdict.STALLED))
    watchdog: Any = SimpleNamespace(check=lambda *_, **__: next(verdicts))
    watcher: Any = SimpleNamespace(pulse=lambda: None)
    tolerated: list[bool] = []
    thread = threading.Thread(
        target=lambda: tolerated.extend(
            watched._tolerates(watchdog, watcher) for _ in range(4)
        ),
        daemon=True,
    )
    thread.start()
    thread.join(5.0)
    assert tolerated == [True, True, True, False]
    read.set()
    watched._words.put(None)
    watched._speaker.join(5.0)
    assert len(lines) == 3


@pytest.mark.parametrize("error", [SystemExit(1), OSError(28)])
def test_a_line_that_cannot_be_written_leaves_the_next_to_be_tried(
    error: BaseException,
) -> None:
    lines: list[str] = []

    def report(line: str) -> None:
        lines.append(line)
        raise error

    watched = side(report)
    for line in ("late", "goes on"):
        watched._say(line)
    watched._words.put(None)
    watched._speaker.join(5.0)
    assert lines == ["late", "goes on"]


def test_a_watchdog_that_fails_ends_its_process_and_the_run(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    watched = Supervisor(cast(Any, None), Settings(), name="test-unread")
    killed: list[bool] = []
    child: Any = SimpleNamespace(kill=lambda: killed.append(watched.running))

    def fail() -> str:
        raise OSError("lost")

    monkeypatch.setattr(watched, "_child", child)
    monkeypatch.setattr(watched, "_watch_process", fail)
    monkeypatch.setattr(supervisor, "prioritize_thread", lambda _: "")
    with pytest.raises(OSError, match="lost"):
        watched._watch()
    assert killed == [True]
    assert not watched.running
