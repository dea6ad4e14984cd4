"""Calls between two networks, each with a router of its own (`tests.call.networks`)."""

import json
import os
import subprocess
import sys
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import soundfile

from .networks import End, Networks, needs_namespaces

pytestmark = [needs_namespaces, pytest.mark.realtime]


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


def connect(ends: tuple[End, End], *, relayed: bool) -> str:
    """Check what each end finds, and that each receives what the other one sends; return the secret of both."""
    found = [end.next("found") for end in ends]
    assert found[0][:3] == ["answer", "operator", relayed]
    assert found[1][:3] == ["call", "robot", relayed]
    assert found[0][4] == found[1][4]
    for end in ends:
        sent, received, longest = end.next("exchanged")
        # One end begins some time before the other one reads.
        assert received > 0.3 * sent
        assert longest < 0.5
        assert end.next("lost") == ""
    return str(found[0][4])


def test_two_homes_find_a_direct_way_which_holds_longer_than_their_routers_remember(homes: Networks) -> None:
    secret = connect(begin(homes, "--seconds", "4"), relayed=False)
    # The same two, with what they remember instead of a code.
    remembered = [homes.end("ope", "call", "--secret", secret), homes.end("rob", "answer", "--secret", secret)]
    assert remembered[0].next("code") == remembered[1].next("code")
    remembered[1].next("asked")
    connect((remembered[0], remembered[1]), relayed=False)


def test_a_wrong_code_tells_both_ends_and_the_next_code_reaches_somebody_who_may_decline(homes: Networks) -> None:
    caller = homes.end("ope", "call")
    number = caller.next("code").partition("-")[0]
    stranger = homes.end("rob", "answer", f"{number}-wrong-words")
    stranger.next("code")
    for end in (caller, stranger):
        assert "the code is wrong, or somebody else tried it" in end.next("error")
    caller, answerer = begin(homes, "--decline")
    assert caller.next("error") == "the other end refused the call: it was not accepted"
    assert answerer.next("error") == "you did not accept the call"


def test_two_calls_at_once_pass_through_one_relay_where_no_direct_way_exists(offices: Networks) -> None:
    first, second = begin(offices), begin(offices)
    connect(first, relayed=True)
    connect(second, relayed=True)


def test_two_networks_that_need_a_relay_and_have_none_say_so(offices: Networks) -> None:
    # From two STUN servers each end knows what kind of router it is behind.
    ends = begin(offices, "--set", "call.turn=", "--set", "call.stun=10.9.0.10,10.9.0.11")
    for end in ends:
        error = end.next("error")
        assert error.count("its router takes another port for each destination") == 2
        assert "this pair needs a relay, call.turn: see *Your own exchange*" in error


def test_a_network_that_blocks_udp_says_so(homes: Networks) -> None:
    block = "table ip block { chain through { type filter hook forward priority -1; meta l4proto udp drop; }; }"
    homes.nft("natrob", block)
    try:
        caller, answerer = begin(homes)
        assert "no STUN server answers: UDP to the internet is blocked" in answerer.next("error")
        assert "there, no STUN server answers" in caller.next("error")
    finally:
        homes.nft("natrob", "delete table ip block")


def test_a_changing_router_reaches_an_open_network_directly() -> None:
    with Networks("changes", "open", relay=False) as networks:
        connect(begin(networks), relayed=False)


def test_two_homes_with_ipv6_alone_find_a_direct_way() -> None:
    with Networks("open", "open", relay=False, ipv6=True) as networks:
        connect(begin(networks), relayed=False)


def test_the_two_commands_feel_a_recording_through_a_relay_and_hang_up_with_a_word(
    offices: Networks, tmp_path: Path
) -> None:
    sound = np.random.default_rng(1).normal(0.0, 0.1, (96_000, 2))
    soundfile.write(tmp_path / "noise.wav", sound, 48_000)
    words = {
        "ope": ["call", "--actuator", "none"],
        "rob": ["answer", "--yes", "--source", f"file:{tmp_path}/noise.wav"],
    }

    def start(place: str, *more: str) -> "subprocess.Popen[str]":
        run = [*words[place], *more, "--json", "--name", f"test-{place}-{os.getpid()}", *offices.settings()]
        command = [sys.executable, "-m", "tactophone", *run, "--set", f"link.identity={tmp_path / place}"]
        return offices.start(place, *command, stdout=subprocess.PIPE, stderr=subprocess.PIPE)

    operator = start("ope")
    assert operator.stderr is not None
    code = operator.stderr.readline().split()[-1]
    robot = start("rob", code)
    assert any("connected to" in line for line in operator.stderr)
    time.sleep(1.0)
    operator.terminate()  # as a person's q
    heard, said = operator.communicate(timeout=20)[0], robot.communicate(timeout=20)
    assert (operator.returncode, robot.returncode) == (0, 0)
    assert json.loads(heard)["counters"]["packets_received"] > 50
    assert "connected over the relay" in said[1]
    assert "hung up" in said[1].splitlines()[-1]


def test_check_says_which_router_is_here_and_which_way_a_call_would_take(offices: Networks, homes: Networks) -> None:
    for networks, router in ((offices, "its router takes another port"), (homes, "its router keeps one port")):
        more = ["--set", "call.stun=10.9.0.10,10.9.0.11"]
        command = [sys.executable, "-m", "tactophone", "call", "--check", *networks.settings(), *more]
        said = networks.start("rob", *command, stdout=subprocess.PIPE).communicate(timeout=30)[0].splitlines()
        assert router in said[0]
        assert said[1:4] == [
            "STUN: 10.9.0.10:3478, 10.9.0.11:3478 answered", "mailbox: answers", "relay: gives an address",
        ]  # fmt: skip
        assert "direct" in said[-1]
