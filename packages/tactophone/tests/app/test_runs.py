"""A run from Python is the run of `tactophone loopback`."""

import time
from collections.abc import Iterator
from contextlib import suppress
from pathlib import Path

import pytest

from tactophone.app.runs import loopback, observed
from tactophone.core.errors import ConfigError
from tactophone.core.settings import Settings, change
from tactophone.live.telemetry.layout import RunState
from tactophone.live.telemetry.prediction_log import PredictionLog
from tactophone.live.telemetry.writer import Telemetry

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


@pytest.mark.parametrize("fails", [False, True])
def test_a_run_is_muted_before_its_log_ends(
    fails: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """After Ctrl-C the finger vibrated for the minute that a log on a slow disk got."""
    asked: list[str] = []

    def end(*_: object) -> None:
        asked.extend(request.action for request in telemetry.requests())

    def bridges(*_: object) -> Iterator[None]:
        if fails:
            raise KeyboardInterrupt
        yield from ()

    name = f"test-{tmp_path.name}"
    monkeypatch.setattr(PredictionLog, "__exit__", end)
    monkeypatch.setattr("tactophone.app.runs._bridges", bridges)
    with Telemetry(name) as telemetry:
        telemetry.update(RunState(role="operator"), now=time.monotonic())
        with (
            suppress(KeyboardInterrupt),
            observed(Settings(), name, record=[tmp_path / "run.csv"]),
        ):
            pass
    assert asked == ["mute"]
