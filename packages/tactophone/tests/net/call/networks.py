"""Two homes behind routers, in network namespaces of this machine, with a mailbox and a
coturn between them.

robot 10.1.0.2 - its router - 10.9.0.0/24, where the servers are at 10.9.0.10 - the
other router - operator 10.2.0.2.
"""

import contextlib
import functools
import os
import shutil
import subprocess
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any, Literal, TypeAlias

import pytest

from tests.support.unplugged import prefix_of_networks, remove_network

from .end import End, Ends, enter_network

Nat: TypeAlias = Literal["keeps", "changes", "open"]

PLACES = ("rob", "natrob", "net", "natope", "ope")
SERVERS = "10.9.0.10"
SECOND = "10.9.0.11"
SERVERS6 = "fd09::10"
USER = "u:p"
ROOT = Path(__file__).parents[5]
PYTHONPATH = os.pathsep.join(
    map(str, (*ROOT.glob("packages/*/src"), *ROOT.glob("packages/*"), ROOT))
)

needs_namespaces = pytest.mark.skipif(
    os.name != "posix"
    or os.geteuid() != 0
    or any(shutil.which(tool) is None for tool in ("ip", "nft", "turnserver")),
    reason="network namespaces need root and Debian's iproute2, nftables and coturn",
)


def run(command: str) -> None:
    subprocess.run(command.split(), check=True, capture_output=True)


def batch(namespace: str, *commands: str) -> None:
    """Run commands of `ip` in a namespace."""
    lines = "\n".join(commands)
    done = subprocess.run(
        ["ip", "-n", namespace, "-batch", "-"],
        input=lines,
        text=True,
        capture_output=True,
    )
    assert done.returncode == 0, f"{lines}\n{done.stderr}"


@functools.cache
def ends() -> Ends:
    """Return the process that forks ends and mailboxes; it ends with this one."""
    return Ends().__enter__()


class Networks:
    """The five namespaces and the processes in them; a context manager."""

    def __init__(
        self,
        robot: Nat,
        operator: Nat,
        *,
        relay: bool = True,
        forget: int = 0,
        ipv6: bool = False,
    ) -> None:
        self._nats = {"rob": robot, "ope": operator}
        self._relay = relay
        self._forget = forget
        self._ipv6 = ipv6
        self._prefix = prefix_of_networks()
        self._processes: list[subprocess.Popen[str]] = []
        self.relay: subprocess.Popen[str] | None = None

    def __enter__(self) -> "Networks":
        with contextlib.ExitStack() as stack:
            stack.callback(self.__exit__)
            self._build()
            ends().start(self._prefix + "net", "mailbox")
            if self._relay:
                self.relay = self.start_relay()
            self._await_servers()
            stack.pop_all()
        return self

    def __exit__(self, *_: object) -> None:
        for process in self._processes:
            process.kill()
            process.wait()
        for name in PLACES:
            remove_network(self._prefix + name)

    def start(
        self, place: str, *command: str, **options: Any
    ) -> "subprocess.Popen[str]":
        environment = options.pop("env", {**os.environ, "PYTHONPATH": PYTHONPATH})
        process = subprocess.Popen(
            ["ip", "netns", "exec", self._prefix + place, *command],
            text=True,
            bufsize=1,
            env=environment,
            stdout=options.pop("stdout", subprocess.DEVNULL),
            stderr=options.pop("stderr", subprocess.DEVNULL),
            **options,
        )
        self._processes.append(process)
        return process

    def start_relay(self, *options: str) -> "subprocess.Popen[str]":
        # One thread: with several at one address, datagrams of one client reach
        # different ones.
        return self.start(
            "net",
            "turnserver",
            "-n",
            "-m",
            "1",
            "-a",
            "-u",
            USER,
            "-r",
            "lab",
            "--listening-ip",
            SERVERS,
            "--listening-ip",
            SECOND,
            "--relay-ip",
            SERVERS,
            "--no-tls",
            "--no-dtls",
            "--no-cli",
            "--pidfile",
            "",
            "--log-file",
            "stdout",
            # As in the guide: a relay must not lead into a network of its own.
            "--denied-peer-ip",
            "10.1.0.0-10.2.255.255",
            *options,
        )

    def end(self, place: str, *words: str) -> "End":
        """Start one end of a call (`tests.net.call.end`) in a home."""
        first = next(
            (place for place, word in enumerate(words) if word.startswith("--")),
            len(words),
        )
        return ends().start(
            self._prefix + place, *words[:first], *self.settings(), *words[first:]
        )

    def settings(self) -> list[str]:
        mailbox = (
            f"ws://[{SERVERS6}]:4000/v1" if self._ipv6 else f"ws://{SERVERS}:4000/v1"
        )
        relay = [f"call.turn={USER}@{SERVERS}"] if self._relay else []
        return [
            word
            for each in (f"call.mailbox={mailbox}", f"call.stun={SERVERS}", *relay)
            for word in ("--set", each)
        ]

    def pids(self, place: str) -> list[int]:
        found = subprocess.run(
            ["ip", "netns", "pids", self._prefix + place],
            capture_output=True,
            text=True,
            check=False,
        )
        return [int(each) for each in found.stdout.split()]

    def namespace(self, place: str) -> str:
        return self._prefix + place

    @contextlib.contextmanager
    def entered(self, place: str) -> Iterator[None]:
        """Let this thread open its sockets at a place meanwhile."""
        before = os.open(
            f"/proc/self/task/{threading.get_native_id()}/ns/net", os.O_RDONLY
        )
        enter_network(f"/run/netns/{self._prefix}{place}")
        try:
            yield
        finally:
            enter_network(f"/proc/self/fd/{before}")
            os.close(before)

    def udp_ports(self, place: str) -> set[int]:
        """Return the ports of the UDP sockets at a place."""
        shown = subprocess.run(
            ["ip", "netns", "exec", self._prefix + place, "ss", "-Hnua"],
            capture_output=True,
            text=True,
        )
        return {
            int(line.split()[3].rpartition(":")[2])
            for line in shown.stdout.splitlines()
        }

    def ip(self, place: str, *commands: str) -> None:
        batch(self._prefix + place, *commands)

    def nft(self, place: str, rules: str) -> None:
        subprocess.run(
            ["ip", "netns", "exec", self._prefix + place, "nft", "-f", "-"],
            input=rules,
            text=True,
            check=True,
        )

    def _build(self) -> None:
        p = self._prefix
        for name in PLACES:
            run(f"ip netns add {p}{name}")
            batch(p + name, "link set lo up")
        addresses = [
            f"addr add {each} dev br0"
            for each in (f"{SERVERS}/24", f"{SECOND}/24", f"{SERVERS6}/64 nodad")
        ]
        # Without a route, coturn ends the session of whoever names a private address.
        route = "route add default via 10.9.0.254"
        batch(
            f"{p}net", "link add br0 type bridge", "link set br0 up", *addresses, route
        )
        self._routes: list[tuple[str, str]] = []
        for number, place in enumerate(("rob", "ope"), 1):
            self._home(number, place)
        for place, route in self._routes:
            self.ip(place, route)

    def _home(self, number: int, place: str) -> None:
        p, router = self._prefix, f"nat{place}"
        # The name of one end only: the other one appears in its namespace.
        batch(
            p + place,
            f"link add eth0 type veth peer name lan netns {p}{router}",
            "link set eth0 up",
        )
        up = [
            f"link add wan type veth peer name {place}0 netns {p}net",
            "link set lan up",
            "link set wan up",
        ]
        batch(p + router, *up)
        batch(f"{p}net", f"link set {place}0 master br0 up")
        if self._ipv6:
            own = [
                f"addr add fd0{number}::2/64 dev eth0 nodad",
                f"route add default via fd0{number}::1",
            ]
            between = [
                f"addr add fd0{number}::1/64 dev lan nodad",
                f"addr add fd09::{number}/64 dev wan nodad",
            ]
            run(f"ip netns exec {p}{router} sysctl -qw net.ipv6.conf.all.forwarding=1")
            batch(
                p + router,
                *between,
                f"route add fd0{3 - number}::/64 via fd09::{3 - number}",
            )
            batch(p + place, *own)
            batch(f"{p}net", f"route add fd0{number}::/64 via fd09::{number}")
            return
        batch(
            p + router,
            f"addr add 10.{number}.0.1/24 dev lan",
            f"addr add 10.9.0.{number}/24 dev wan",
        )
        batch(
            p + place,
            f"addr add 10.{number}.0.2/24 dev eth0",
            f"route add default via 10.{number}.0.1",
        )
        run(f"ip netns exec {p}{router} sysctl -qw net.ipv4.ip_forward=1")
        if self._nats[place] == "open":
            route = f"route add 10.{number}.0.0/24 via 10.9.0.{number}"
            batch(f"{p}net", route)
            self._routes.append((f"nat{'ope' if place == 'rob' else 'rob'}", route))
            return
        # A router that takes unasked packets for its own learns them, and maps the next
        # one to another port: dropped.
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
                run(
                    f"ip netns exec {p}{router} sysctl -qw "
                    f"net.netfilter.nf_conntrack_{name}={self._forget}"
                )

    def _await_servers(self) -> None:
        for port in (4000, *((3478,) if self._relay else ())):
            for _ in range(200):
                listening = subprocess.run(
                    [
                        "ip",
                        "netns",
                        "exec",
                        self._prefix + "net",
                        "ss",
                        "-Hlntu",
                        f"sport = :{port}",
                    ],
                    capture_output=True,
                    text=True,
                )
                if listening.stdout:
                    break
                time.sleep(0.05)
