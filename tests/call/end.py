"""One end of a call without sound: finds the way, sends 100 datagrams a second over it and counts the other end's."""

import argparse
import json
import time

from tactophone.call.process import CallProcess, Plan
from tactophone.errors import TactophoneError
from tactophone.link.identity import Identity
from tactophone.link.way import WaySocket
from tactophone.settings import Settings, change

INTERVAL = 0.01


def tell(kind: str, content: object) -> None:
    print(json.dumps([kind, content]), flush=True)


def main() -> None:
    parser = argparse.ArgumentParser()
    parser.add_argument("verb", choices=("call", "answer"))
    parser.add_argument("code", nargs="?", default="")
    parser.add_argument("--secret", default="")
    parser.add_argument("--set", action="append", default=[])
    parser.add_argument("--seconds", type=float, default=1.0)
    parser.add_argument("--decline", action="store_true")
    args = parser.parse_args()
    settings = change(Settings(), args.set).call
    answers = args.verb == "answer"
    plan = Plan(
        settings, answers, args.code, bytes.fromhex(args.secret), args.verb, Identity.create("end").fingerprint,
        "" if answers else "operator",
    )  # fmt: skip
    with CallProcess(plan) as process:
        try:
            for step, content in process.steps():
                if step == "asked":
                    process.answer(not args.decline)
                if step != "found":
                    tell(step, content)
                    continue
                way = content.way
                tell("found", [content.name, content.role, content.relayed, way.peer, content.secret.hex()])
                exchange(way, args.seconds)
                tell("lost", process.failure)
        except TactophoneError as error:
            tell("error", str(error))


def exchange(way: object, seconds: float) -> None:
    socket = WaySocket(way)
    own, received, longest, last = 0, set[bytes](), 0.0, time.monotonic()
    until = last + seconds + 0.5
    with socket:
        while (now := time.monotonic()) < until:
            # SRTP by its first byte; a few of them are lost before the other end reads.
            if now < until - 0.5:
                socket.send([(b"\x80\x60" + own.to_bytes(4), way.peer)])
                own += 1
            for datagram, source in socket.receive(INTERVAL):
                assert source == way.peer, source
                if received:
                    longest = max(longest, now - last)
                received.add(datagram)
                last = now
            time.sleep(max(0.0, now + INTERVAL - time.monotonic()))
    tell("exchanged", [own, len(received), longest])


if __name__ == "__main__":
    main()
