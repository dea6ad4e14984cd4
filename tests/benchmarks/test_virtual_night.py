"""Nights of calls on one virtual clock; `python benchmarks/endurance.py --seeds 1000`
has longer ones."""

import pytest

from benchmarks.virtual_night import BrokenPromiseError, live_through
from tactophone.live.runtime.watchdog import Verdict, Watchdog

pytest.importorskip("mcap")

HOURS = 1 / 6
SOUND = 0.5


@pytest.mark.long
def test_five_short_nights_keep_every_promise() -> None:
    # In these five every kind of event happens.
    nights = [live_through(seed, hours=HOURS, sound=SOUND) for seed in range(1, 6)]
    assert sum(night.felt for night in nights) > 200
    assert sum(night.compared for night in nights) > 100


def test_a_night_notices_that_its_watchdog_sees_nothing(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(Watchdog, "check", lambda *_, **__: Verdict.ALIVE)
    with pytest.raises(BrokenPromiseError, match="of a frozen process"):
        live_through(1, hours=HOURS, sound=SOUND)
