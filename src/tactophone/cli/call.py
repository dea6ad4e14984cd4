"""``tactophone call`` and ``answer``: `send` and `receive` between any two networks, found by a spoken code."""

import argparse
import os
import re
import secrets
import signal
import socket
import sys
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Literal

from tactophone.cli import audio, live, options, output, page
from tactophone.errors import ConfigError
from tactophone.settings import Settings

if TYPE_CHECKING:
    from tactophone.call.messages import Role
    from tactophone.call.process import CallProcess, Found
    from tactophone.link.identity import Identity
    from tactophone.runtime.supervisor import Supervisor

EXAMPLES = {
    "call": ("tactophone call", "tactophone call --robot --source finger --remember lab", "tactophone call --check"),
    "answer": (
        "tactophone answer 3-escapade-peachy",
        "tactophone answer 3-escapade-peachy --source finger --remember home",
        "tactophone answer home --yes",
    ),
}

WATCH_INTERVAL = 0.5
"""Seconds between two looks at the process that keeps the way open."""


def add_arguments(parser: argparse.ArgumentParser) -> None:
    answers = parser.get_default("verb") == "answer"
    if answers:
        parser.add_argument("code", help="that `tactophone call` shows there, or a name given to --remember")
        parser.add_argument("--yes", action="store_true", help="accept whoever has the code, without a question")
    else:
        parser.add_argument("code", nargs="?", default="", metavar="name", help="of an end that --remember knows")
        parser.add_argument(
            "--check", action="store_true", help="only say which router is here, and which way a call would take"
        )
    usual = "what the caller is not" if answers else "the operator"
    parser.add_argument(
        "--robot", action="store_const", const="robot", dest="role", help=f"be the robot (default: {usual})"
    )
    parser.add_argument("--operator", action="store_const", const="operator", dest="role", help="be the operator")
    parser.add_argument(
        "--remember", default="", metavar="NAME", help="keep the other end's fingerprint and a secret: then no code"
    )
    live.add_arguments(parser, parser.get_default("verb"))


def run(args: argparse.Namespace) -> int:
    """Find the other end, and run this side until either hangs up."""
    from tactophone.call.process import CallProcess, Plan
    from tactophone.link.identity import IDENTITY_FOLDER

    settings = options.settings_of(args)
    if args.verb == "call" and args.check:
        with CallProcess(settings.call) as process:
            for _, sentences in process.steps():
                print("\n".join(sentences))
                return 0
    folder = Path(settings.link.identity or IDENTITY_FOLDER).expanduser()
    answers = args.verb == "answer"
    if answers and not args.yes and not sys.stdin.isatty():
        raise ConfigError(
            "nobody can accept the call, as there is no terminal: add --yes to accept whoever has the code"
        )
    identity = _identity(folder)
    spoken = bool(re.match(r"\d+-", args.code))
    secret = _secret_of(folder, args.code) if args.code and not spoken else b""
    role: Role | Literal[""] = args.role or ("" if answers else "operator")
    name = re.sub(r"[^\w.+-]", "-", identity.name, flags=re.ASCII)[:64] or "unnamed"
    plan = Plan(settings.call, answers, args.code if spoken else "", secret, name, identity.fingerprint, role)
    with CallProcess(plan) as process:
        found = _found(process, args)
        if args.code and not spoken and _fingerprint_of(folder, args.code) != found.fingerprint:
            raise ConfigError(f"the other end is not {args.code}: its key is another one; call with a code instead")
        if args.remember:
            _remember(folder, args.remember, found)
        return _follow(args, settings, process, found, identity)


def _found(process: "CallProcess", args: argparse.Namespace) -> "Found":
    """Show the code, ask the person, and return the other end with the way to it."""
    found = None
    for step, content in process.steps():
        if step == "code" and not args.code:
            output.note(f"your code: {content}")
            output.log().print(f"on the other machine: tactophone answer {content}", style="dim", soft_wrap=True)
        elif step == "code":
            output.log().print("waiting for the other end ...", style="dim")
        elif step == "asked":
            caller, role, version = content
            output.note(f"{caller} calls, the {role}, with tactophone {version}")
            process.answer(args.yes or input("accept? [y/N] ").strip().lower() in ("y", "yes"))
        elif step == "found":
            found = content
    if found is None:
        raise ConfigError("there is no other end")
    how = "over the relay" if found.relayed else f"directly to {found.way.peer[0]}"
    output.note(f"{found.name}: connected {how} in {found.after:.1f} s, encrypted; you are the {found.role}")
    return found  # type: ignore[no-any-return]


def _follow(
    args: argparse.Namespace, settings: Settings, process: "CallProcess", found: "Found", identity: "Identity"
) -> int:
    from tactophone.link.identity import Peers
    from tactophone.runtime.pairing import temporary_keys

    name = settings.process.name or args.verb
    host, port = found.way.peer
    with temporary_keys() as keys:
        identity.save(keys / "own")
        Peers({found.fingerprint: found.name}).save(keys / "own")
        settings = replace(
            settings,
            link=replace(settings.link, identity=str(keys / "own"), peer=f"[{host}]:{port}"),
            rendering=replace(settings.rendering, muted=True),
            process=replace(settings.process, name=name),
        )
        threading.Thread(target=_end_with_way, args=(process,), daemon=True).start()
        source = audio.source_of(settings, page=page.wanted(args, settings)) if found.role == "robot" else None
        code = live.follow(
            args, settings, _side(settings, found, name, source), name, microphone=source.microphone if source else None
        )
    return 1 if process.failure else code


@contextmanager
def _side(
    settings: Settings, found: "Found", name: str, source: "audio.PageSource | None"
) -> "Iterator[Sequence[Supervisor]]":
    from tactophone.runtime.operator import run_operator
    from tactophone.runtime.robot import run_robot
    from tactophone.runtime.supervisor import Supervisor, supervised

    if source:
        main = partial(run_robot, open_source=source.open, way=found.way)
    else:
        main = partial(run_operator, way=found.way)
    with supervised(Supervisor(main, settings, name=name, report=output.note)) as sides:
        yield sides


def _end_with_way(process: "CallProcess") -> None:
    """End the run as SIGTERM does once the way is lost for good."""
    while not (failure := process.failure):
        time.sleep(WATCH_INTERVAL)
    output.warn(failure)
    os.kill(os.getpid(), signal.SIGTERM)


def _identity(folder: Path) -> "Identity":
    """Return this machine's identity; a first call makes it."""
    from tactophone.link.identity import KEY_FILE, Identity

    if not (folder / KEY_FILE).exists():
        Identity.create(socket.gethostname()).save(folder)
    return Identity.load(folder)


def _secret_path(folder: Path, name: str) -> Path:
    if not re.fullmatch(r"[A-Za-z][\w.+-]{0,63}", name, flags=re.ASCII):
        raise ConfigError(
            f"{name!r} is neither a code, such as 3-escapade-peachy, nor a name: letters first, no spaces"
        )
    return folder / "calls" / name


def _secret_of(folder: Path, name: str) -> bytes:
    path = _secret_path(folder, name)
    with suppress(OSError, ValueError):
        if secret := bytes.fromhex(path.read_text()):
            return secret
    raise ConfigError(f"{path} holds no secret of an earlier call: call once with a code and --remember {name}")


def _fingerprint_of(folder: Path, name: str) -> str:
    from tactophone.link.identity import Peers

    return dict(Peers.load(folder).items()).get(name, "")


def _remember(folder: Path, name: str, found: "Found") -> None:
    """Trust the other end from now on, and keep the secret from which both derive the next code."""
    from tactophone.link.identity import Peers

    path = _secret_path(folder, name)
    path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
    draft = path.with_name(f".{name}.{secrets.token_hex(4)}")
    with os.fdopen(os.open(draft, os.O_WRONLY | os.O_CREAT | os.O_EXCL, 0o600), "w") as file:
        file.write(found.secret.hex())
    draft.replace(path)
    Peers.load(folder).trusting(name, found.fingerprint).save(folder)
    output.note(f"remembered: `tactophone call {name}` and `tactophone answer {name}` need no code")
