"""``tactophone pair``: create this machine's key, show its fingerprint, and trust the other machine's."""

import argparse
import socket
from pathlib import Path

from tactophone.cli import options, output

EXAMPLES = ("tactophone pair init", "tactophone pair show", "tactophone pair trust robot 0123:4567:89ab:cdef")


def add_arguments(parser: argparse.ArgumentParser) -> None:
    steps = parser.add_subparsers(title="steps", metavar="STEP", required=True)
    init = steps.add_parser("init", help="create a key and a certificate, once for each machine")
    init.add_argument("--name", default=socket.gethostname(), help="what other machines call this one")
    show = steps.add_parser("show", help="print this machine's fingerprint and those it trusts")
    options.add_json(show, "print an object that a program can read")
    trust = steps.add_parser("trust", help="accept the machine that has this fingerprint")
    trust.add_argument("name", help="what to call it here")
    trust.add_argument("fingerprint", help="as `tactophone pair show` prints it there")
    forget = steps.add_parser("forget", help="stop accepting a machine")
    forget.add_argument("name", help="as given to `pair trust`")
    for step, action in ((init, _init), (show, _show), (trust, _trust), (forget, _forget)):
        step.add_argument("--identity", type=Path, metavar="FOLDER",
            help="where keys are kept (default: ~/.config/tactophone)")  # fmt: skip
        step.set_defaults(step=action)


def run(args: argparse.Namespace) -> int:
    from tactophone.link.identity import IDENTITY_FOLDER

    args.identity = (args.identity or IDENTITY_FOLDER).expanduser()
    args.step(args)
    return 0


def _init(args: argparse.Namespace) -> None:
    from tactophone.link.identity import Identity

    Identity.create(args.name).save(args.identity)
    output.log().print(f"Created a key in {args.identity}. Only you can read it; keep it so.")
    output.log().print("On the other machine, run:")
    print(Identity.load(args.identity).trust_command)


def _show(args: argparse.Namespace) -> None:
    from tactophone.link.identity import Identity, Peers

    identity, peers = Identity.load(args.identity), Peers.load(args.identity)
    if not args.json:
        output.log().print("On the other machine, run:")
    # A fingerprint is no secret, but the channel that it is compared by must be trusted.
    shown = {"name": identity.name, "fingerprint": identity.fingerprint, "trusted": dict(peers.items())}
    trusted = (f"trusted: {name} {fingerprint}" for name, fingerprint in peers.items())
    output.show(shown, [identity.trust_command, *trusted], as_json=args.json)


def _trust(args: argparse.Namespace) -> None:
    from tactophone.link.identity import Peers

    Peers.load(args.identity).trusting(args.name, args.fingerprint).save(args.identity)
    output.log().print(f"{args.name} is trusted from the next start on.")


def _forget(args: argparse.Namespace) -> None:
    from tactophone.link.identity import Peers

    Peers.load(args.identity).without(args.name).save(args.identity)
    output.log().print(f"{args.name} is not trusted from the next start on.")
