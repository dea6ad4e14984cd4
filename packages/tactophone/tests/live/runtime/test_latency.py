import math

import numpy as np
import pytest

from tactophone.live.runtime.latency import follow, operator_stages, robot_stages
from tactophone.live.telemetry.layout import MARK, MARKS
from tactophone.live.telemetry.watcher import Watcher
from tactophone.live.telemetry.writer import Telemetry
from tactophone.net.link.codec import Codec

WRAP = 1 << 32


def marks(*rows: tuple[int, float]) -> np.ndarray:
    return np.array(list(rows), MARK)


def test_a_stretch_is_followed_to_the_first_mark_at_or_beyond_its_end() -> None:
    times = follow(
        {
            "decoded": marks((240, 1.0), (480, 2.0)),
            "sent": marks((128, 0.1), (256, 0.2), (384, 0.3), (512, 0.4)),
        }
    )
    assert times["sent"].tolist() == [0.2, 0.4]


def test_stretches_are_followed_over_the_wrap_of_the_timestamp() -> None:
    times = follow(
        {
            "decoded": marks((WRAP - 120, 1.0), (0, 2.0), (120, 3.0)),
            "detected": marks((WRAP - 120, 4.0), (0, 5.0), (120, 6.0)),
        }
    )
    assert (times["detected"] - times["decoded"]).tolist() == [3.0, 3.0, 3.0]


def test_what_has_not_come_through_yet_is_left_out() -> None:
    times = follow(
        {"decoded": marks((120, 1.0), (240, 2.0)), "detected": marks((120, 1.5))}
    )
    assert times["decoded"].tolist() == [1.0]
    assert (
        follow({"decoded": marks((120, 1.0)), "detected": marks()})["decoded"].size == 0
    )


def test_a_new_session_is_measured_by_its_own_marks_alone() -> None:
    """Its timestamps begin anywhere: before or behind all that came before."""
    for began in (WRAP // 2 + 7, 3_000_000_000):
        old, new = (
            [(120 * n, float(n)) for n in range(50)],
            [(began + 120 * n, 100.0 + n) for n in range(3)],
        )
        received = marks(*old, *new)
        times = follow(
            {
                "received": received,
                "sent": marks(*((place, time - 0.25) for place, time in new)),
            }
        )
        assert (times["received"] - times["sent"]).tolist() == [0.25] * 3
        assert (
            follow({"rendered": marks(*old), "received": received})["received"].size
            == 0
        )


@pytest.mark.parametrize("name", ["doctest-budget"])
def test_the_stages_add_up_to_the_total(name: str) -> None:
    codec = Codec("opus", packet_size=120)
    lags = dict(
        zip(
            MARKS,
            np.cumsum([0.0, 0.001, 0.002, 0.0, 0.0005, 0.0005, 0.001]),
            strict=True,
        )
    )
    with Telemetry(name) as telemetry:
        for packet in range(1, 50):
            for index, mark in enumerate(MARKS):
                telemetry.mark((index, 120 * packet, packet + lags[mark]))
        watcher = Watcher(name)
        robot = robot_stages(watcher, codec)
        for stage, duration in robot.items():
            telemetry.gauge(f"latency_{stage}", duration)
        stages = operator_stages(watcher, watcher, device_latency=0.003)
        passed_through = operator_stages(watcher, watcher, 0.003, sound_delay=0.02)
    assert robot["capture"] == pytest.approx(60 / 48_000)
    assert robot["encode"] == pytest.approx((60 + 120) / 48_000 + 0.001)
    assert stages["network"] == pytest.approx(0.002)
    assert stages["decode"] == pytest.approx(0.0005)
    assert stages["render"] == pytest.approx(0.001)
    assert stages.pop("total") == pytest.approx(math.fsum(stages.values()))
    assert passed_through["total"] == pytest.approx(
        sum(robot.values()) + 0.002 + 0.02 + 0.003
    )


def test_a_run_without_sound_has_no_budget() -> None:
    with Telemetry("doctest-budget") as telemetry:
        watcher = Watcher(telemetry.name)
        assert robot_stages(watcher, Codec()) == {}
        assert math.isnan(operator_stages(watcher, None, device_latency=0.0)["detect"])
