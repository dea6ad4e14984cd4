"""Calls between two networks, each with a router of its own
(`tests.net.call.networks`)."""

import subprocess
import sys
from collections.abc import Iterator

import pytest

from .end import End
from .networks import Networks, needs_namespaces

pytestmark = [needs_namespaces, pytest.mark.realtime]


GIVE_UP_SOON = ("--patch", "tactophone.net.call.ice:ICE_TIMEOUT=2")


@pytest.fixture(scope="module")
def homes() -> Iterator[Networks]:
    """Two homes whose routers keep ports, and forget a destination after 3 s."""
    with Networks("keeps", "keeps", forget=3) as networks:
        yield networks


@pytest.fixture(scope="module")
def offices() -> Iterator[Networks]:
    """Two networks whose routers take another port for each destination."""
    with Networks("changes", "changes") as networks:
        yield networks


def begin(networks: Networks, *options: str) -> tuple[End, End]:
    caller = networks.end("ope", "call", *options)
    code = caller.next("code")
    answerer = networks.end("rob", "answer", code, *options)
    answerer.next("code")
    assert answerer.next("asked")[:2] == ["call", "operator"]
    return caller, answerer


def connect(ends: tuple[End, End], *, relayed: bool) -> list[str]:
    """Check what each end finds, and that each receives what the other one sends;
    return the secrets of both."""
    found = [end.next("found") for end in ends]
    for own, name, role in zip(
        found, ("answer", "call"), ("operator", "robot"), strict=True
    ):
        assert (own["name"], own["role"], own["relayed"], own["again"]) == (
            name,
            role,
            relayed,
            False,
        )
        assert 0.0 < own["round_trip"] < 0.5
    assert found[0]["secrets"] == found[1]["secrets"]
    for end in ends:
        sent, received = end.next("exchanged")
        # One end begins some time before the other one reads.
        assert received > 0.3 * sent
        assert not end.gaps
    return list(found[0]["secrets"])


def test_each_end_hears_how_far_the_other_one_is(homes: Networks) -> None:
    caller, answerer = begin(homes, "--states", "opening", "ready")
    for end in (caller, answerer):
        end.next("found")
        heard = [end.next("state")]
        while heard[-1] != "ready":
            heard.append(end.next("state"))
        assert heard == sorted(set(heard), key=("starting", "opening", "ready").index)


def test_an_older_end_that_knows_no_states_is_called_as_before(homes: Networks) -> None:
    caller = homes.end("ope", "call", "--states", "opening", "ready")
    answerer = homes.end("rob", "answer", caller.next("code"), "--old")
    answerer.next("code")
    answerer.next("asked")
    connect((caller, answerer), relayed=False)


def test_two_homes_find_a_direct_way_which_holds_longer_than_their_routers_remember(
    homes: Networks,
) -> None:
    secrets = connect(begin(homes, "--seconds", "4"), relayed=False)
    # The same two, with what they remember instead of a code.
    renewed = call_again(homes, secrets, secrets)
    assert renewed[1:] == secrets
    # One end missed what the other one remembers, the answering one and then the
    # caller.
    third = call_again(homes, renewed, secrets)
    call_again(homes, renewed, third)


def call_again(homes: Networks, own: list[str], other: list[str]) -> list[str]:
    caller = homes.end("ope", "call", "--seconds", "0.5", "--secrets", *own)
    answerer = homes.end("rob", "answer", "--seconds", "0.5", "--secrets", *other)
    assert (caller.next("code") == answerer.next("code")) is (own == other)
    answerer.next("asked")
    return connect((caller, answerer), relayed=False)


def test_a_wrong_code_tells_both_ends_and_the_next_reaches_somebody_who_may_decline(
    homes: Networks,
) -> None:
    caller = homes.end("ope", "call")
    number = caller.next("code").partition("-")[0]
    stranger = homes.end("rob", "answer", f"{number}-wrong-words")
    stranger.next("code")
    for end in (caller, stranger):
        assert "the code is wrong, or somebody else tried it" in end.next("error")
    caller, answerer = begin(homes, "--decline")
    assert caller.next("error") == "the other end refused the call: it was not accepted"
    assert answerer.next("error") == "you did not accept the call"


def test_two_calls_at_once_pass_through_one_relay_where_no_direct_way_exists(
    offices: Networks,
) -> None:
    first, second = begin(offices), begin(offices)
    connect(first, relayed=True)
    connect(second, relayed=True)


def test_two_networks_that_need_a_relay_and_have_none_say_so(offices: Networks) -> None:
    # From two STUN servers each end knows what kind of router it is behind.
    ends = begin(
        offices,
        "--set",
        "call.turn=",
        "--set",
        "call.stun=10.9.0.10,10.9.0.11",
        *GIVE_UP_SOON,
    )
    for end in ends:
        error = end.next("error")
        assert error.count("its router takes another port for each destination") == 2
        assert "this pair needs a relay, call.turn: see *Your own exchange*" in error


def test_a_network_that_blocks_udp_says_so(homes: Networks) -> None:
    block = (
        "table ip block { chain through { type filter hook forward priority -1; "
        "meta l4proto udp drop; }; }"
    )
    homes.nft("natrob", block)
    try:
        caller, answerer = begin(homes, *GIVE_UP_SOON)
        assert (
            "no STUN server answers: UDP to the internet is blocked"
            in answerer.next("error")
        )
        assert "there, no STUN server answers" in caller.next("error")
    finally:
        homes.nft("natrob", "delete table ip block")


def test_a_changing_router_reaches_an_open_network_directly() -> None:
    with Networks("changes", "open", relay=False) as networks:
        connect(begin(networks), relayed=False)


def test_two_homes_with_ipv6_alone_find_a_direct_way() -> None:
    with Networks("open", "open", relay=False, ipv6=True) as networks:
        connect(begin(networks), relayed=False)


def test_check_says_which_router_is_here_and_which_way_a_call_would_take(
    offices: Networks, homes: Networks
) -> None:
    more = ["--set", "call.stun=10.9.0.10,10.9.0.11"]
    command = [
        sys.executable,
        "-m",
        "tactophone",
        "call",
        "--check",
        *homes.settings(),
        *more,
    ]
    asked = [
        networks.start("rob", *command, stdout=subprocess.PIPE)
        for networks in (offices, homes)
    ]
    routers = ("its router takes another port", "its router keeps one port")
    for process, router in zip(asked, routers, strict=True):
        said = process.communicate(timeout=30)[0].splitlines()
        assert router in said[0]
        assert said[1:4] == [
            "STUN: 10.9.0.10:3478, 10.9.0.11:3478 answered",
            "mailbox: answers",
            "relay: gives an address",
        ]
        assert "direct" in said[-1]
