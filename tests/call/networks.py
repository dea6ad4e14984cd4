"""Two homes behind routers, in network namespaces of this machine, with a mailbox and a coturn between them.

robot 10.1.0.2 - its router - 10.9.0.0/24, where the servers are at 10.9.0.10 - the other router - operator 10.2.0.2.
"""

import contextlib
import itertools
import json
import os
import select
import shutil
import subprocess
import sys
import time
from pathlib import Path
from typing import Any, Literal, TypeAlias

import pytest

Nat: TypeAlias = Literal["keeps", "changes", "open"]

SERVERS, SECOND, SERVERS6 = "10.9.0.10", "10.9.0.11", "fd09::10"
USER = "u:p"
TIMEOUT = 25.0
SOURCES = Path(__file__).parents[2]

needs_namespaces = pytest.mark.skipif(
    os.name != "posix" or os.geteuid() != 0 or any(shutil.which(tool) is None for tool in ("ip", "nft", "turnserver")),
    reason="network namespaces need root and Debian's iproute2, nftables and coturn",
)

SERVED = """
from twisted.internet import reactor
from wormhole_mailbox_server.server import make_server
from wormhole_mailbox_server.database import create_channel_db
from wormhole_mailbox_server.web import make_web_server
site = make_web_server(make_server(create_channel_db(":memory:")), log_requests=False)
reactor.listenTCP(4000, site, interface="::")
reactor.run()
"""


def run(command: str) -> None:
    subprocess.run(command.split(), check=True, capture_output=True)


_numbers = itertools.count()


class Networks:
    """The five namespaces and the processes in them; a context manager."""

    def __init__(self, robot: Nat, operator: Nat, *, relay: bool = True, forget: int = 0, ipv6: bool = False) -> None:
        self._nats = {"rob": robot, "ope": operator}
        self._relay, self._forget, self._ipv6 = relay, forget, ipv6
        self._prefix = f"tp{os.getpid()}{next(_numbers)}"
        self._processes: list[subprocess.Popen[str]] = []
        self.relay: subprocess.Popen[str] | None = None

    def __enter__(self) -> "Networks":
        with contextlib.ExitStack() as stack:
            stack.callback(self.__exit__)
            self._build()
            self.start("net", sys.executable, "-c", SERVED)
            if self._relay:
                self.relay = self.start_relay()
            self._await_servers()
            stack.pop_all()
        return self

    def __exit__(self, *_: object) -> None:
        for process in self._processes:
            process.kill()
            process.wait()
        for name in ("rob", "natrob", "net", "natope", "ope"):
            subprocess.run(["ip", "netns", "del", self._prefix + name], capture_output=True)

    def start(self, place: str, *command: str, **options: Any) -> "subprocess.Popen[str]":
        environment = {**os.environ, "PYTHONPATH": f"{SOURCES / 'src'}:{SOURCES}"}
        process = subprocess.Popen(
            ["ip", "netns", "exec", self._prefix + place, *command],
            text=True, bufsize=1, env=environment, stdout=options.pop("stdout", subprocess.DEVNULL),
            stderr=options.pop("stderr", subprocess.DEVNULL), **options,
        )  # fmt: skip
        self._processes.append(process)
        return process

    def start_relay(self, *options: str) -> "subprocess.Popen[str]":
        # One thread: with several at one address, datagrams of one client reach different ones.
        return self.start(
            "net", "turnserver", "-n", "-m", "1", "-a", "-u", USER, "-r", "lab",
            "--listening-ip", SERVERS, "--listening-ip", SECOND,
            "--relay-ip", SERVERS, "--no-tls", "--no-dtls", "--no-cli", "--pidfile", "", "--log-file", "stdout",
            # As in the guide: a relay must not lead into a network of its own.
            "--denied-peer-ip", "10.1.0.0-10.2.255.255", *options,
        )  # fmt: skip

    def end(self, place: str, *words: str) -> "End":
        """Start one end of a call (`tests.call.end`) in a home."""
        first = next((place for place, word in enumerate(words) if word.startswith("--")), len(words))
        command = [sys.executable, "-m", "tests.call.end", *words[:first], *self.settings(), *words[first:]]
        return End(self.start(place, *command, stdout=subprocess.PIPE, stderr=None))

    def settings(self) -> list[str]:
        mailbox = f"ws://[{SERVERS6}]:4000/v1" if self._ipv6 else f"ws://{SERVERS}:4000/v1"
        relay = [f"call.turn={USER}@{SERVERS}"] if self._relay else []
        return [
            word for each in (f"call.mailbox={mailbox}", f"call.stun={SERVERS}", *relay) for word in ("--set", each)
        ]

    def nft(self, place: str, rules: str) -> None:
        subprocess.run(
            ["ip", "netns", "exec", self._prefix + place, "nft", "-f", "-"], input=rules, text=True, check=True
        )

    def _build(self) -> None:
        p = self._prefix
        for name in ("rob", "natrob", "net", "natope", "ope"):
            subprocess.run(["ip", "netns", "del", p + name], capture_output=True)
            run(f"ip netns add {p}{name}")
            run(f"ip -n {p}{name} link set lo up")
        run(f"ip -n {p}net link add br0 type bridge")
        run(f"ip -n {p}net link set br0 up")
        self._address("net", "br0", f"{SERVERS}/24", f"{SECOND}/24", f"{SERVERS6}/64")
        # Without a route, coturn ends the session of whoever names a private address.
        run(f"ip -n {p}net route add default via 10.9.0.254")
        for number, place in enumerate(("rob", "ope"), 1):
            self._home(number, place)

    def _home(self, number: int, place: str) -> None:
        p, router = self._prefix, f"nat{place}"
        # The name of one end only: the other one appears in its namespace.
        run(f"ip -n {p}{place} link add eth0 type veth peer name lan netns {p}{router}")
        run(f"ip -n {p}{router} link add wan type veth peer name {place}0 netns {p}net")
        run(f"ip -n {p}net link set {place}0 master br0 up")
        for where, link in ((place, "eth0"), (router, "lan"), (router, "wan")):
            run(f"ip -n {p}{where} link set {link} up")
        if self._ipv6:
            self._address(place, "eth0", f"fd0{number}::2/64")
            self._address(router, "lan", f"fd0{number}::1/64")
            self._address(router, "wan", f"fd09::{number}/64")
            run(f"ip -n {p}{place} -6 route add default via fd0{number}::1")
            run(f"ip -n {p}net -6 route add fd0{number}::/64 via fd09::{number}")
            run(f"ip -n {p}{router} -6 route add fd0{3 - number}::/64 via fd09::{3 - number}")
            run(f"ip netns exec {p}{router} sysctl -qw net.ipv6.conf.all.forwarding=1")
            return
        self._address(place, "eth0", f"10.{number}.0.2/24")
        self._address(router, "lan", f"10.{number}.0.1/24")
        self._address(router, "wan", f"10.9.0.{number}/24")
        run(f"ip -n {p}{place} route add default via 10.{number}.0.1")
        run(f"ip netns exec {p}{router} sysctl -qw net.ipv4.ip_forward=1")
        if self._nats[place] == "open":
            run(f"ip -n {p}net route add 10.{number}.0.0/24 via 10.9.0.{number}")
            run(f"ip -n {p}nat{'ope' if place == 'rob' else 'rob'} route add 10.{number}.0.0/24 via 10.9.0.{number}")
            return
        # A router that takes unasked packets for its own learns them, and maps the next one to another port: dropped.
        ports = "fully-random" if self._nats[place] == "changes" else ""
        self.nft(
            router,
            f"""
table ip nat {{
  chain post {{
    type nat hook postrouting priority 100;
    oifname "wan" masquerade {ports}
  }}
}}
table ip filter {{
  chain local {{
    type filter hook input priority 0;
    iifname "wan" drop
  }}
  chain through {{
    type filter hook forward priority 0; policy drop;
    ct state established,related accept
    iifname != "wan" accept
  }}
}}""",
        )
        if self._forget:
            for name in ("udp_timeout", "udp_timeout_stream"):
                run(f"ip netns exec {p}{router} sysctl -qw net.netfilter.nf_conntrack_{name}={self._forget}")

    def _address(self, place: str, link: str, *addresses: str) -> None:
        for address in addresses:
            nodad = " nodad" if ":" in address else ""
            run(f"ip -n {self._prefix}{place} addr add {address} dev {link}{nodad}")

    def _await_servers(self) -> None:
        for port in (4000, *((3478,) if self._relay else ())):
            for _ in range(200):
                listening = subprocess.run(
                    ["ip", "netns", "exec", self._prefix + "net", "ss", "-Hlntu", f"sport = :{port}"],
                    capture_output=True, text=True,
                )  # fmt: skip
                if listening.stdout:
                    break
                time.sleep(0.05)


class End:
    """One end of a call, which prints an object for each thing that happens."""

    def __init__(self, process: "subprocess.Popen[str]") -> None:
        self.process = process

    def next(self, kind: str) -> Any:
        """Return the content of the next line, which is of that kind."""
        assert self.process.stdout is not None
        # A line comes whole, and none is buffered here: each is read when it is there.
        ready = select.select([self.process.stdout], [], [], TIMEOUT)[0]
        line = self.process.stdout.readline() if ready else ""
        assert line, f"wanted {kind}, but nothing came within {TIMEOUT:g} s"
        found, content = json.loads(line)
        assert found == kind, (found, content)
        return content
