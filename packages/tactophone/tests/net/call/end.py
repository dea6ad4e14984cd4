"""One end of a call without sound: finds the path, sends 100 datagrams a second over it
and counts the other end's.

Importing what a call needs takes a second of processor time, so one process does that
once, and forks each end into its network (`Ends`).
"""

import argparse
import ctypes
import importlib
import json
import math
import multiprocessing
import os
import select
import signal
import socket
import subprocess
import sys
import threading
import time
import traceback
from collections.abc import Callable
from dataclasses import asdict
from typing import Any

from tactophone.core import processes
from tactophone.core.errors import TactophoneError
from tactophone.core.settings import Settings, change
from tactophone.net.call.process import CallProcess, Plan, _Call
from tactophone.net.link.call_socket import PEER, CallSocket
from tactophone.net.link.identity import Identity

INTERVAL = 0.01
GAP = 1.0
"""Seconds without a datagram that are told: more than a busy machine stalls for."""

TIMEOUT = 25.0
_NEW_NETWORK = 0x40000000


class Ends:
    """The process that forks the ends; a context manager."""

    def __enter__(self) -> "Ends":
        self._own, its = socket.socketpair(socket.AF_UNIX, socket.SOCK_SEQPACKET)
        command = [sys.executable, "-m", "tests.net.call.end", str(its.fileno())]
        self._process = subprocess.Popen(command, pass_fds=[its.fileno()])
        its.close()
        return self

    def __exit__(self, *_: object) -> None:
        self._own.close()
        self._process.wait(10)

    def start(self, namespace: str, *words: str) -> "End":
        reading, writing = os.pipe()
        socket.send_fds(
            self._own, [json.dumps([namespace, *words]).encode()], [writing]
        )
        os.close(writing)
        return End(reading)


class End:
    """One end of a call, which prints an object for each thing that happens."""

    def __init__(self, pipe: int) -> None:
        # Without a buffer, as a line in it would not wake `select`.
        self._lines = os.fdopen(pipe, "rb", buffering=0)
        self.gaps: list[float] = []

    def ready(self) -> bool:
        """Whether something has happened."""
        return bool(select.select([self._lines], [], [], 0.0)[0])

    def next(self, kind: str, timeout: float = TIMEOUT) -> Any:
        """Return the content of the next line, which is of that kind; gaps before it
        are kept in ``gaps``."""
        while True:
            ready = select.select([self._lines], [], [], timeout)[0]
            line = self._lines.readline() if ready else b""
            assert line, f"wanted {kind}, but nothing came within {timeout:g} s"
            found, content = json.loads(line)
            if found == "gap":
                self.gaps.append(content)
            if found == kind:
                return content
            assert found == "gap", (found, content)


def enter_network(namespace: str) -> None:
    """Let this thread open its sockets in a namespace, of that path, from now on."""
    network = os.open(namespace, os.O_RDONLY)
    try:
        if ctypes.CDLL(None, use_errno=True).setns(network, _NEW_NETWORK):
            raise OSError(ctypes.get_errno(), "setns")
    finally:
        os.close(network)


def serve_mailbox() -> None:
    from twisted.internet import reactor
    from wormhole_mailbox_server.database import create_channel_db
    from wormhole_mailbox_server.server import make_server
    from wormhole_mailbox_server.web import make_web_server

    site = make_web_server(
        make_server(create_channel_db(":memory:")), log_requests=False
    )
    reactor.listenTCP(4000, site, interface="::")  # type: ignore[attr-defined]
    reactor.run()  # type: ignore[attr-defined]


def serve(requests: socket.socket) -> None:
    """Fork an end for each request."""
    # What the process of a call would otherwise import.
    import tactophone.net.call.check
    import tactophone.net.call.exchange  # noqa: F401

    signal.signal(signal.SIGCHLD, signal.SIG_IGN)
    processes._ChildContext = lambda: multiprocessing.get_context("fork")  # type: ignore[assignment,misc]
    # A fork pickles nothing.
    processes._Later.unpickle = lambda later: later._value  # type: ignore[method-assign]
    while True:
        message, descriptors, *_ = socket.recv_fds(requests, 1 << 16, 1)
        if not message:
            return
        namespace, *words = json.loads(message)
        if os.fork() == 0:
            requests.close()
            signal.signal(signal.SIGCHLD, signal.SIG_DFL)
            os.dup2(descriptors[0], 1)
            try:
                enter_network(f"/run/netns/{namespace}")
                serve_mailbox() if words == ["mailbox"] else run(words)
            except BaseException:
                traceback.print_exc()
            finally:
                os._exit(0)
        os.close(descriptors[0])


def tell(kind: str, content: object) -> None:
    os.write(1, (json.dumps([kind, content]) + "\n").encode())


def run(words: list[str]) -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("verb", choices=("call", "answer"))
    parser.add_argument("code", nargs="?", default="")
    parser.add_argument("--secrets", nargs="*", default=[])
    parser.add_argument("--set", action="append", default=[])
    parser.add_argument(
        "--seconds", type=float, default=1.0, help="from the last path on"
    )
    parser.add_argument("--paths", type=int, default=1)
    parser.add_argument("--decline", action="store_true")
    parser.add_argument(
        "--states",
        nargs="*",
        help="to tell once there is a path; then the other end's are told too",
    )
    parser.add_argument(
        "--old", action="store_true", help="say nothing of states, as an older version"
    )
    parser.add_argument(
        "--patch",
        action="append",
        default=[],
        help="MODULE:NAME=NUMBER, for times of minutes",
    )
    args = parser.parse_args(words)
    for text in args.patch:
        place, _, number = text.partition("=")
        module, _, name = place.partition(":")
        setattr(importlib.import_module(module), name, float(number))
    if args.old:
        _Call._states = lambda call, exchange, exchanges: exchanges.aclose()  # type: ignore[method-assign]
    settings = change(Settings(), args.set).call
    answers = args.verb == "answer"
    secrets, own = (
        tuple(map(bytes.fromhex, args.secrets)),
        Identity.create("end").fingerprint,
    )
    plan = Plan(
        settings,
        answers,
        args.code,
        secrets,
        args.verb,
        own,
        "" if answers else "operator",
    )
    with CallProcess(plan) as process:
        found: list[float] = []
        failed = threading.Event()

        def follow() -> None:
            try:
                for step, content in process.steps():
                    if step == "asked":
                        process.answer(not args.decline)
                    if step != "state" or args.states:
                        tell(step, asdict(content) if step == "found" else content)
                    if step == "found":
                        for state in args.states or ():
                            process.say(state)
                        found.append(time.monotonic())
            except TactophoneError as error:
                tell("error", str(error))
                failed.set()

        threading.Thread(target=follow, daemon=True).start()
        while not (found or failed.wait(INTERVAL)):
            pass
        if found:
            ends_at = lambda: (  # noqa: E731
                found[args.paths - 1] + args.seconds
                if len(found) >= args.paths
                else math.inf
            )
            exchange(process, ends_at, failed)


def exchange(
    process: CallProcess, ends_at: Callable[[], float], failed: threading.Event
) -> None:
    """Exchange datagrams, and report each gap in the other end's datagrams when it is
    over."""
    path = CallSocket(process.agent)
    own = 0
    received = set[bytes]()
    last = time.monotonic()
    with path:
        while (now := time.monotonic()) < ends_at() + 0.5 and not failed.is_set():
            # SRTP by its first byte; a few of them are lost before the other end reads.
            if now < ends_at():
                path.send([(b"\x80\x60" + own.to_bytes(4), PEER)])
                own += 1
            for datagram, source in path.receive(INTERVAL):
                if source != PEER or datagram[:2] != b"\x80\x60":
                    continue  # a stranger's: the session would refuse it
                if received and now - last > GAP:
                    tell("gap", now - last)
                received.add(datagram)
                last = now
            time.sleep(max(0.0, now + INTERVAL - time.monotonic()))
    if not failed.is_set():
        tell("exchanged", [own, len(received)])


if __name__ == "__main__":
    serve(socket.socket(fileno=int(sys.argv[1])))
