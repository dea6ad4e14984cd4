"""``tactophone pair``: create this machine's key, show its fingerprint, and trust the other machine's."""

import argparse
import socket
from pathlib import Path
from typing import TYPE_CHECKING

from tactophone.cli._support import terminal

if TYPE_CHECKING:
    from tactophone.link import Identity


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Declare the verb's arguments."""
    steps = parser.add_subparsers(title="steps", metavar="STEP", required=True)
    init = steps.add_parser("init", help="create a key and a certificate, once for each machine")
    init.add_argument("--name", default=socket.gethostname(), help="what other machines call this one")
    show = steps.add_parser("show", help="print this machine's fingerprint and those it trusts")
    show.add_argument("--json", action="store_true", help="print an object that a program can read")
    trust = steps.add_parser("trust", help="accept the machine that has this fingerprint")
    trust.add_argument("name", help="what to call it here")
    trust.add_argument("fingerprint", help="as `tactophone pair show` prints it there")
    forget = steps.add_parser("forget", help="stop accepting a machine")
    forget.add_argument("name", help="as given to `pair trust`")
    for step, action in ((init, _init), (show, _show), (trust, _trust), (forget, _forget)):
        step.add_argument(
            "--identity", type=Path, metavar="FOLDER", help="where keys are kept (default: ~/.config/tactophone)"
        )
        step.set_defaults(step=action)


def run(args: argparse.Namespace) -> int:
    """Run the chosen step."""
    from tactophone.link import IDENTITY_FOLDER

    args.identity = (args.identity or IDENTITY_FOLDER).expanduser()
    args.step(args)
    return 0


def _init(args: argparse.Namespace) -> None:
    from tactophone.link import Identity

    Identity.create(args.name).save(args.identity)
    terminal.log().print(f"Created a key in {args.identity}. Only you can read it; keep it so.")
    _print_trust_command(Identity.load(args.identity))


def _show(args: argparse.Namespace) -> None:
    from tactophone.link import Identity, Peers

    identity, peers = Identity.load(args.identity), Peers.load(args.identity)
    if args.json:
        trusted = dict(peers.items())
        terminal.print_json({"name": identity.name, "fingerprint": identity.fingerprint, "trusted": trusted})
        return
    _print_trust_command(identity)
    for name, fingerprint in peers.items():
        print(f"trusted: {name} {fingerprint}")


def _trust(args: argparse.Namespace) -> None:
    from tactophone.link import Peers

    Peers.load(args.identity).trusting(args.name, args.fingerprint).save(args.identity)
    terminal.log().print(f"{args.name} is trusted from the next start on.")


def _forget(args: argparse.Namespace) -> None:
    from tactophone.link import Peers

    Peers.load(args.identity).without(args.name).save(args.identity)
    terminal.log().print(f"{args.name} is not trusted from the next start on.")


def _print_trust_command(identity: "Identity") -> None:
    """Print the line to run on the other machine: a fingerprint is no secret, but its channel must be trusted."""
    terminal.log().print("On the other machine, run:")
    print(identity.trust_command)
