"""Clocks that are set and processes that stand still: nothing stale vibrates, the link
goes on, the logs replay."""

from pathlib import Path

import pytest

from tests.support.kills import (
    DAY,
    RunningLink,
    WallClock,
    left_by,
    needs_compiler,
    running_link,
)

pytestmark = pytest.mark.realtime


def goes_on(link: RunningLink) -> None:
    """Check that no process began anew, and that the logs replay."""
    assert link.restarts() == 0
    finding = left_by(link.run)
    assert finding.wrong == []
    assert finding.equal > 100


@needs_compiler
def test_a_link_outlives_a_wall_clock_set_by_a_day(tmp_path: Path) -> None:
    clock = WallClock(tmp_path)
    with running_link(tmp_path, f"test-{tmp_path.name[-20:]}", clock) as link:
        for offset in (DAY, -DAY):
            clock.set(offset)
            assert link.longest_gap(0.6) < 0.3
        goes_on(link)


def test_a_link_outlives_a_stop_of_both_ends(tmp_path: Path) -> None:
    with running_link(tmp_path, f"test-{tmp_path.name[-20:]}") as link:
        until_fresh, stale = link.stop(5.2)  # longer than a session waits for its peer
        assert until_fresh < 3.0
        assert stale == 0.0
        goes_on(link)
