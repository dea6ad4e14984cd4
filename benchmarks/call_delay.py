"""How long a datagram of a call waits in the process that passes it on.

A datagram of 160 bytes goes from one session to the other every 5 ms, at first between
two plain UDP sockets, then with the process of a call at one end.

    python benchmarks/call_delay.py
"""

import argparse
import asyncio
import multiprocessing
import resource
import socket
import threading
import time
from typing import Any

import numpy as np

from tactophone.net.call.guard import GuardedLoop
from tactophone.net.call.passage import Passage
from tactophone.net.link.call_socket import PEER, CallPeer, CallSocket
from tactophone.net.link.udp import UdpSocket

PERIOD = 0.005
SIZE = 160


class Line(asyncio.DatagramProtocol):
    """A path over loopback, in place of the one that aioice finds."""

    def __init__(self) -> None:
        self.deliver: Any = None
        self._transport: Any = None
        self._target: Any = None

    def connection_made(self, transport: Any) -> None:
        self._transport = transport

    def datagram_received(self, data: bytes, source: Any) -> None:
        self._target = source
        if self.deliver:
            self.deliver(data)

    async def send(self, datagram: bytes) -> None:
        self._transport.sendto(datagram, self._target)


def keep(live: socket.socket, told: list[Any], ready: threading.Event) -> None:
    loop = GuardedLoop()

    async def main() -> None:
        transport, line = await loop.create_datagram_endpoint(
            Line, local_addr=("127.0.0.1", 0)
        )
        told.append(transport.get_extra_info("sockname"))
        passage = Passage(live, loop.follow)
        passage.use(line, CallPeer("other", "0A"))
        ready.set()
        await passage.run()

    loop.run_until_complete(main())


def delays(own: Any, other: UdpSocket, target: Any, count: int) -> list[float]:
    """Return the delays of datagrams from ``other`` to ``own``, in s."""
    found = []
    for _ in range(count):
        began = time.perf_counter()
        other.send([(b"\x80" + bytes(SIZE - 1), target)])
        while not own.receive(1.0):
            pass
        found.append(time.perf_counter() - began)
        time.sleep(PERIOD)
    return found


def print_row(words: str, found: list[float]) -> None:
    p50, p99 = 1_000 * np.percentile(found, (50, 99))
    print(f"| {words} | {p50:.3f} | {p99:.3f} |")


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument(
        "--count", type=int, default=2_000, help="datagrams of each (default: 2000)"
    )
    args = parser.parse_args()
    with UdpSocket("127.0.0.1") as own, UdpSocket("127.0.0.1") as other:
        plain = delays(own, other, own.address, args.count)
    here, live = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
    told: list[Any] = []
    ready = threading.Event()
    # Its own process, so that neither waits for the other one's interpreter.
    context = multiprocessing.get_context("fork")
    pipe, its = context.Pipe()

    def child() -> None:
        here.close()
        threading.Thread(
            target=lambda: (ready.wait(), its.send(told[0])), daemon=True
        ).start()
        keep(live, told, ready)
        its.send(resource.getrusage(resource.RUSAGE_SELF)[:2])

    process = context.Process(target=child)
    process.start()
    live.close()
    with UdpSocket("127.0.0.1") as other, CallSocket(here) as own:
        passed = delays(own, other, pipe.recv(), args.count)
    own.send([(b"last", PEER)])
    here.close()
    user, system = pipe.recv()
    process.join()
    print("| datagram | p50, ms | p99, ms |\n|---|--:|--:|")
    print_row("between two UDP sockets", plain)
    print_row("through the process of a call", passed)
    added = 1_000 * (np.median(passed) - np.median(plain))
    processor = 1e6 * (user + system) / args.count
    print(
        f"\nThe process of the call adds {added:.3f} ms at p50, and takes "
        f"{processor:.0f} us of processor time for each datagram."
    )


if __name__ == "__main__":
    main()
