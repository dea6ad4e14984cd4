"""Whichever process of a run is killed, its log replays to the bit, and nothing of the
run is left."""

import random
from pathlib import Path

import pytest

from tests.support.kills import demonstration, kill, loopback

pytestmark = pytest.mark.realtime


@pytest.mark.parametrize("victim", ["command 1", "operator", "everything"])
def test_a_run_whose_process_is_killed_leaves_its_log_and_nothing_else(
    tmp_path: Path, victim: str
) -> None:
    finding = kill(tmp_path, loopback, random.Random(1), running=True, victim=victim)
    assert finding.wrong == []
    assert finding.equal >= 30
    assert finding.behind < 2.0


def test_a_demonstration_killed_as_it_starts_leaves_nothing(tmp_path: Path) -> None:
    assert kill(tmp_path, demonstration, random.Random(1)).wrong == []
