"""``tactophone pair``: create this machine's key, show its fingerprint, and trust the
other machine's."""

import argparse
import socket
from pathlib import Path

from tactophone.cli import options, output

EXAMPLES = (
    "tactophone pair init",
    "tactophone pair show",
    "tactophone pair trust robot 0123:4567:89ab:cdef",
)


def add_arguments(parser: argparse.ArgumentParser) -> None:
    steps = parser.add_subparsers(
        title="steps", dest="step", metavar="STEP", required=True
    )
    init = steps.add_parser(
        "init", help="create a key and a certificate, once for each machine"
    )
    init.add_argument(
        "--name", default=socket.gethostname(), help="what other machines call this one"
    )
    show = steps.add_parser(
        "show", help="print this machine's fingerprint and those it trusts"
    )
    options.add_json(show, "print an object that a program can read")
    trust = steps.add_parser(
        "trust", help="accept the machine that has this fingerprint"
    )
    trust.add_argument("name", help="what to call it here")
    trust.add_argument("fingerprint", help="as `tactophone pair show` prints it there")
    forget = steps.add_parser("forget", help="stop accepting a machine")
    forget.add_argument("name", help="as given to `pair trust`")
    for step in steps.choices.values():
        words = "where keys are kept (default: ~/.config/tactophone)"
        step.add_argument("--identity", type=Path, metavar="FOLDER", help=words)


def run(args: argparse.Namespace) -> int:
    from tactophone.net.link.identity import Identity, Peers, identity_folder

    folder = identity_folder(args.identity or "")
    say = output.log().print
    match args.step:
        case "init":
            Identity.create(args.name).save(folder)
            say(f"Created a key in {folder}. Only you can read it; keep it so.")
            say("On the other machine, run:")
            print(Identity.load(folder).trust_command)
        case "show":
            identity = Identity.load(folder)
            peers = Peers.load(folder)
            if not args.json:
                say("On the other machine, run:")
            # A fingerprint is no secret, but the channel that it is compared by must be
            # trusted.
            shown = {
                "name": identity.name,
                "fingerprint": identity.fingerprint,
                "trusted": dict(peers.items()),
            }
            trusted = (
                f"trusted: {name} {fingerprint}" for name, fingerprint in peers.items()
            )
            output.show(shown, [identity.trust_command, *trusted], as_json=args.json)
        case "trust":
            Peers.load(folder).trusting(args.name, args.fingerprint).save(folder)
            say(f"{args.name} is trusted now, also by a run that has already begun.")
        case "forget":
            Peers.load(folder).without(args.name).save(folder)
            say(
                f"{args.name} is no longer trusted; a run connected to it hangs up now."
            )
    return 0
