"""A run from Python is the run of `tactophone loopback`."""

from pathlib import Path

import pytest

from tactophone.app.runs import loopback, observed
from tactophone.core.errors import ConfigError
from tactophone.core.settings import Settings, change

pytestmark = pytest.mark.realtime


def test_python_runs_both_sides_and_records_them(tmp_path: Path) -> None:
    settings = change(Settings(), ["capture.source=finger", "output.actuator=none"])
    last = loopback(
        settings,
        name=f"test-{tmp_path.name}",
        duration=4.0,
        record=[tmp_path / "run.csv"],
    )
    assert last.counters["packets_received"] > 100
    assert (tmp_path / "run.csv").stat().st_size > 1000


def test_a_file_that_nobody_would_write_is_refused(tmp_path: Path) -> None:
    with pytest.raises(ConfigError, match=r"wanted a file that ends in .mcap or .csv"):
        observed(Settings(), "none", record=[tmp_path / "run.txt"]).__enter__()
