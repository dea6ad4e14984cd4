"""Clocks that are set and processes that stand still: nothing stale vibrates, the link
goes on, the logs replay."""

import shutil
from pathlib import Path

import pytest

from tests.support.kills import DAY, WallClock, left_by, running_link

pytestmark = pytest.mark.realtime


def test_a_link_outlives_a_wall_clock_set_by_a_day_and_a_stop_of_both_ends(
    tmp_path: Path,
) -> None:
    clock = WallClock(tmp_path) if shutil.which("cc") else None
    with running_link(tmp_path, f"test-{tmp_path.name[-20:]}", clock) as link:
        for offset in (DAY, -DAY) if clock else ():
            clock.set(offset)
            assert link.longest_gap(0.6) < 0.3
        until_fresh, stale = link.stop(5.2)  # longer than a session waits for its peer
        assert until_fresh < 3.0
        assert stale == 0.0
        assert link.restarts() == 0
        finding = left_by(link.run)
    assert finding.wrong == []
    assert finding.equal > 100
