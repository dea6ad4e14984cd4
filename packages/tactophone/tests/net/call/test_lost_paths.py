"""Paths that die during a call, and strangers and relays that do harm
(`tests.net.call.networks`)."""

import json
import os
import random
import socket
import struct
import subprocess
import sys
import threading
import time
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import soundfile

from tactophone.live.telemetry.watcher import Watcher
from tactophone.net.link.identity import Peers

from .end import End, enter_network
from .networks import SECOND, SERVERS, USER, Networks, needs_namespaces
from .test_networks import begin

pytestmark = [needs_namespaces, pytest.mark.realtime]

SOON = (
    "--patch",
    "aioice.ice:CONSENT_INTERVAL=0.5",
    "--patch",
    "aioice.ice:CONSENT_FAILURES=3",
)
"""Consent is lost after about 2 s, not after half a minute."""

LONGEST_GAP = 10.0
"""Seconds within which a new path is found, on a machine that other tests keep busy; 5
are wanted of an idle one."""


@pytest.fixture
def homes() -> Iterator[Networks]:
    with Networks("keeps", "keeps") as networks:
        yield networks


def found(ends: tuple[End, End], *, relayed: bool, again: bool = False) -> None:
    for end in ends:
        path = end.next("found")
        assert (path["relayed"], path["again"]) == (relayed, again)


def ended_well(ends: tuple[End, End]) -> None:
    for end in ends:
        sent, received = end.next("exchanged")
        assert received > 0.2 * sent


def test_a_router_that_restarts_with_another_address_and_a_moved_caller_get_new_ways(
    homes: Networks,
) -> None:
    ends = begin(homes, "--paths", "3")
    found(ends, relayed=False)
    time.sleep(0.5)
    homes.ip("natrob", "addr del 10.9.0.1/24 dev wan", "addr add 10.9.0.21/24 dev wan")
    found(ends, relayed=False, again=True)
    homes.ip(
        "ope",
        "addr del 10.2.0.2/24 dev eth0",
        "addr add 10.2.0.3/24 dev eth0",
        "route add default via 10.2.0.1",
    )
    found(ends, relayed=False, again=True)
    ended_well(ends)
    assert all(max(end.gaps) < LONGEST_GAP for end in ends)


def test_a_direct_way_that_is_blocked_is_replaced_by_a_relayed_one(
    homes: Networks,
) -> None:
    ends = begin(homes, "--paths", "2")
    found(ends, relayed=False)
    time.sleep(0.5)
    between = "ip saddr 10.9.0.2 drop; ip daddr 10.9.0.2 drop;"
    homes.nft(
        "natrob",
        f"table ip block {{ chain through {{ type filter hook forward priority -1; "
        f"{between} }}; }}",
    )
    found(ends, relayed=True, again=True)
    ended_well(ends)
    assert all(max(end.gaps) < LONGEST_GAP for end in ends)


def test_a_relays_permission_is_renewed_and_a_dead_relay_ends_the_call() -> None:
    with Networks("changes", "changes", relay=False) as networks:
        relay = networks.start_relay(
            "--permission-lifetime", "3", "--channel-lifetime", "3"
        )
        turn = ("--set", f"call.turn={USER}@{SERVERS}")
        time.sleep(0.5)
        ends = begin(
            networks,
            *turn,
            *SOON,
            "--seconds",
            "30",
            "--patch",
            "tactophone.net.call.aioice_defaults:CHANNEL_REFRESH=1",
        )
        found(ends, relayed=True)
        time.sleep(7.0)
        assert all(not end.ready() for end in ends), "not one gap"
        relay.kill()
        for end in ends:
            assert (
                "the route to the other end is lost, and no other one was found"
                in end.next("error")
            )


def test_a_relay_that_drops_duplicates_replays_and_redirects_ends_nothing(
    homes: Networks,
) -> None:
    lying = LyingRelay(homes)
    turn = (
        "--set",
        f"call.turn={USER}@{SECOND}:{LyingRelay.PORT}",
        "--set",
        "call.relay_only=true",
    )
    ends = begin(homes, *turn, "--seconds", "4")
    found(ends, relayed=True)
    lying.begin()
    ended_well(ends)
    assert min(lying.counts.values()) > 10, lying.counts


def test_a_stranger_who_floods_the_punched_port_ends_and_delays_nothing() -> None:
    with Networks("open", "open") as networks:
        ends = begin(networks, "--seconds", "4")
        found(ends, relayed=False)
        flooded = 0
        with (
            networks.entered("net"),
            socket.socket(socket.AF_INET, socket.SOCK_RAW, socket.IPPROTO_RAW) as raw,
        ):
            ports = {place: networks.udp_ports(place) for place in ("rob", "ope")}
            until = time.monotonic() + 2.0
            while time.monotonic() < until:
                for target, source in (
                    ("10.1.0.2", "10.2.0.2"),
                    ("10.2.0.2", "10.1.0.2"),
                ):
                    own, other = (
                        ports["rob" if each == "10.1.0.2" else "ope"]
                        for each in (target, source)
                    )
                    for host, port in (
                        (SERVERS, 9),
                        *((source, each) for each in other),
                    ):
                        for first in (
                            b"\x00\x01",
                            b"\x01\x01",
                            b"\x03chosen",
                            b"\x16\xfe\xfd",
                            b"\x40\x00",
                        ):
                            for to in own:
                                raw.sendto(
                                    udp(host, port, target, to, first + os.urandom(60)),
                                    (target, 0),
                                )
                                flooded += 1
                time.sleep(0.002)
        ended_well(ends)
        assert flooded > 2_000
        assert all(max(end.gaps, default=0.0) < 2.0 for end in ends)


def udp(source: str, port: int, target: str, to: int, content: bytes) -> bytes:
    """Return an IPv4 packet from any source; its checksums are the kernel's, or left
    out."""
    length = 8 + len(content)
    addresses = socket.inet_aton(source) + socket.inet_aton(target)
    header = (
        struct.pack("!BBHHHBBH", 0x45, 0, 20 + length, 0, 0, 64, socket.IPPROTO_UDP, 0)
        + addresses
    )
    return header + struct.pack("!HHHH", port, to, length, 0) + content


class LyingRelay:
    """Stands between the ends and the relay: from `begin` on it does to datagrams what
    it likes."""

    PORT = 3500

    def __init__(self, networks: Networks) -> None:
        self.counts = {"dropped": 0, "duplicated": 0, "replayed": 0, "redirected": 0}
        self._lies = False
        self._random = random.Random(1)
        with networks.entered("net"):
            self._front = socket.socket(socket.AF_INET, socket.SOCK_DGRAM)
            self._front.bind((SECOND, self.PORT))
        self._networks = networks
        self._backs: dict[tuple[str, int], socket.socket] = {}
        self._old: list[bytes] = []
        threading.Thread(target=self._serve, daemon=True).start()

    def begin(self) -> None:
        self._lies = True

    def _serve(self) -> None:
        # The network changes for this thread alone.
        enter_network(f"/run/netns/{self._networks.namespace('net')}")
        while True:
            datagram, client = self._front.recvfrom(4096)
            if client not in self._backs:
                back = self._backs[client] = socket.socket(
                    socket.AF_INET, socket.SOCK_DGRAM
                )
                back.connect((SERVERS, 3478))
                threading.Thread(
                    target=self._return, args=(back, client), daemon=True
                ).start()
            for each in self._changed(datagram):
                self._backs[client].send(each)

    def _return(self, back: socket.socket, client: tuple[str, int]) -> None:
        while True:
            for each in self._changed(back.recv(4096)):
                others = [other for other in self._backs if other != client]
                if self._lies and others and self._random.random() < 0.05:
                    self.counts["redirected"] += 1
                    self._front.sendto(each, others[0])
                self._front.sendto(each, client)

    def _changed(self, datagram: bytes) -> list[bytes]:
        if not self._lies:
            return [datagram]
        self._old = [*self._old[-50:], datagram]
        match self._random.randrange(20):
            case 0 | 1:
                self.counts["dropped"] += 1
                return []
            case 2 | 3:
                self.counts["duplicated"] += 1
                return [datagram, datagram]
            case 4:
                self.counts["replayed"] += 1
                return [self._old[0], datagram]
        return [datagram]


def test_the_two_commands_stop_and_go_on_with_the_relay_and_hang_up_when_forgotten(
    tmp_path: Path,
) -> None:
    sound = np.random.default_rng(1).normal(0.0, 0.1, (960_000, 2))
    soundfile.write(tmp_path / "noise.wav", sound, 48_000)
    name = f"test-lost-{os.getpid()}"
    with Networks("changes", "changes") as networks:

        def start(place: str, *words: str) -> "subprocess.Popen[str]":
            own = ["--set", f"link.identity={tmp_path / place}", *networks.settings()]
            command = [sys.executable, "-m", "tactophone", *words, *own]
            return networks.start(
                place, *command, stdout=subprocess.PIPE, stderr=subprocess.PIPE
            )

        remembering = ("--remember", "lab", "--json")
        operator = start(
            "ope", "call", "--actuator", "none", "--name", name, *remembering
        )
        assert operator.stderr
        code = operator.stderr.readline().split()[-1]
        robot = start(
            "rob",
            "answer",
            code,
            "--yes",
            "--source",
            f"file:{tmp_path}/noise.wav",
            "--name",
            f"{name}-r",
        )
        assert any("connected over the relay" in line for line in operator.stderr)
        while (watcher := Watcher.find(name)) is None:
            time.sleep(0.01)
        watcher.ask("arm")

        def vibrates(wanted: bool, timeout: float) -> None:
            until = time.monotonic() + timeout
            while (watcher.gauge("output_amplitude") > 0.0) is not wanted:
                assert time.monotonic() < until
                time.sleep(0.002)

        vibrates(True, 20.0)
        time.sleep(1.0)
        assert networks.relay
        networks.relay.kill()
        vibrates(False, 1.0)  # 0.1 s of the network, and what a busy machine adds
        networks.start_relay()
        vibrates(True, 20.0)
        # As `pair forget lab` does.
        Peers.load(tmp_path / "ope").without("lab").save(tmp_path / "ope")
        said, heard = robot.communicate(timeout=20), operator.communicate(timeout=20)
        assert (operator.returncode, robot.returncode) == (0, 0)
        for each in (said[1], heard[1]):
            assert "the route was lost; connected over the relay" in each
        assert "hung up" in said[1].splitlines()[-1]
        assert "lab is no longer trusted: this machine hangs up" in heard[1]
        assert json.loads(heard[0])["counters"]["packets_received"] > 50
