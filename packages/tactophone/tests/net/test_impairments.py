"""The impaired link: statistics, order, and repeatability."""

from itertools import cycle, groupby, islice

import numpy as np
import pytest

from tactophone.core.errors import ConfigError
from tactophone.net.impairment import (
    NETWORK_PROFILES,
    ImpairedLink,
    NetworkProfile,
    deliveries,
    network_profile,
)


def carried(
    profile: NetworkProfile, *, seed: int = 0, packets: int = 2_000
) -> list[tuple[float, bytes]]:
    """Send a packet every 5 ms and read every 0.1 ms."""
    link = ImpairedLink(profile, seed=seed)
    out = []
    sent = 0
    for count in range(packets * 50 + 20_000):
        now = count * 1e-4
        if count % 50 == 0 and sent < packets:
            link.push(sent.to_bytes(4), now=now)
            sent += 1
        out += [(now, datagram) for datagram in link.pull(now)]
    return out


@pytest.mark.parametrize("profile", NETWORK_PROFILES.values(), ids=NETWORK_PROFILES)
def test_a_seed_repeats_a_link(profile: NetworkProfile) -> None:
    assert carried(profile, seed=5, packets=500) == carried(
        profile, seed=5, packets=500
    )


@pytest.mark.slow
@pytest.mark.parametrize(
    ("loss", "burst"), [(0.05, 1.0), (0.05, 5.0), (0.2, 1.0), (0.2, 3.0)]
)
def test_loss_and_bursts_are_as_specified(loss: float, burst: float) -> None:
    lost = [
        not delays
        for delays in islice(
            deliveries(NetworkProfile(loss=loss, burst=burst), seed=1), 200_000
        )
    ]
    runs = [len(list(run)) for bad, run in groupby(lost) if bad]
    assert np.mean(lost) == pytest.approx(loss, rel=0.1)
    assert np.mean(runs) == pytest.approx(max(burst, 1 / (1 - loss)), rel=0.1)


def test_deliveries_do_not_depend_on_the_time_between_packets() -> None:
    link = NetworkProfile(loss=0.3)
    slow, fast = ImpairedLink(link, seed=2), ImpairedLink(link, seed=2)
    for k in range(100):
        slow.push(bytes([k]), now=float(k))
        fast.push(bytes([k]), now=0.0)
    assert slow.pull(1e9) == fast.pull(1e9)


def test_jitter_has_its_mean_and_keeps_the_order() -> None:
    out = carried(NetworkProfile(delay=0.01, jitter=0.001))
    late = [now - 0.005 * int.from_bytes(datagram) for now, datagram in out]
    assert np.mean(late) == pytest.approx(0.011, abs=0.0003)
    assert [datagram for _, datagram in out] == sorted(datagram for _, datagram in out)


def test_packets_overtake_where_the_profile_allows_it() -> None:
    order = [
        datagram
        for _, datagram in carried(NetworkProfile(spread=0.03, overtaking=True))
    ]
    assert order != sorted(order)
    assert len(order) == 2_000


def test_a_stall_ends_in_a_burst() -> None:
    out = carried(NetworkProfile(stall=0.2, stall_interval=2.0))
    bursts = [len(list(run)) for _, run in groupby(out, key=lambda pair: pair[0])]
    assert max(bursts) in range(39, 42)
    assert len(out) == 2_000


def test_duplicates_arrive_twice() -> None:
    assert len(carried(NetworkProfile(duplicates=0.1))) == pytest.approx(
        2_200, rel=0.02
    )


def test_loss_can_be_listed() -> None:
    link = ImpairedLink(NetworkProfile(), lost=cycle([False, True]))
    for k in range(6):
        link.push(bytes([k]), now=0)
    assert link.pull(0) == [bytes([0]), bytes([2]), bytes([4])]


@pytest.mark.parametrize(
    "wrong",
    [
        "marsnet",
        "wifi,loss",
        "wifi,speed=3",
        "loss=2",
        "wifi,loss=much",
        "loss=nan",
        "jitter=nan",
        "delay=inf",
    ],
)
def test_an_invalid_profile_is_refused(wrong: str) -> None:
    with pytest.raises(ConfigError):
        network_profile(wrong)


@pytest.mark.parametrize(
    "wrong",
    [
        "loss=2",
        "duplicates=1.5",
        "burst=0",
        "delay=-1",
        "jitter=nan",
        "stall=inf",
        "stall_interval=0",
    ],
)
def test_what_is_out_of_range_is_named(wrong: str) -> None:
    name, value = wrong.split("=")
    with pytest.raises(ConfigError, match=f"a network's {name} .*, not {value}"):
        network_profile(wrong)
