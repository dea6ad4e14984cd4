"""``tactophone call`` and ``answer``: `send` and `receive` between any two networks,
found by a spoken code."""

import argparse
import math
import os
import re
import secrets
import signal
import socket
import sys
import threading
import time
from collections.abc import Iterator, Sequence
from contextlib import AbstractContextManager, ExitStack, contextmanager, suppress
from functools import partial
from multiprocessing.connection import Connection
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

from tactophone.app import runs, sources
from tactophone.cli import live, options, output, page
from tactophone.core.errors import ConfigError, TactophoneError
from tactophone.core.settings import Settings, change

if TYPE_CHECKING:
    from tactophone.live.runtime.supervisor import Supervisor
    from tactophone.net.call.messages import Role
    from tactophone.net.call.process import CallProcess, Found, Step
    from tactophone.net.link.identity import Identity

EXAMPLES = {
    "call": (
        "tactophone call",
        "tactophone call --robot --source finger --remember lab",
        "tactophone call --check",
    ),
    "answer": (
        "tactophone answer",
        "tactophone answer --source finger --remember home",
        "tactophone answer home --yes",
    ),
}


def add_arguments(parser: argparse.ArgumentParser) -> None:
    answers = parser.get_default("verb") == "answer"
    if answers:
        parser.add_argument(
            "code",
            nargs="*",
            metavar="CODE",
            help="as `tactophone call` shows it there, or a name given to --remember; "
            "without one you are asked, so that no other user of this machine reads it",
        )
        parser.add_argument(
            "--yes",
            action="store_true",
            help="accept whoever has the code, without a question",
        )
    else:
        parser.add_argument(
            "code",
            nargs="?",
            default="",
            metavar="NAME",
            help="given to --remember before",
        )
        words = (
            "only say which kind of router is here, and which route a call would take"
        )
        parser.add_argument("--check", action="store_true", help=words)
    usual = "what the caller is not" if answers else "the operator"
    words = f"be the robot (default: {usual})"
    parser.add_argument(
        "--robot", action="store_const", const="robot", dest="role", help=words
    )
    parser.add_argument(
        "--operator",
        action="store_const",
        const="operator",
        dest="role",
        help="be the operator",
    )
    words = "keep the other end's fingerprint and a secret: the next call needs no code"
    parser.add_argument("--remember", default="", metavar="NAME", help=words)
    live.add_arguments(parser)


def run(args: argparse.Namespace) -> int:
    from tactophone.live.runtime.priority import prepare_passing
    from tactophone.live.runtime.supervisor import left_by_sigterm
    from tactophone.net.call.process import CallProcess, Plan
    from tactophone.net.link.identity import identity_folder

    settings = options.settings_of(args)
    if args.verb == "call" and args.check:
        with CallProcess(settings.call) as process:
            for _, sentences in process.steps():
                print("\n".join(sentences))
                return 0
    folder = identity_folder(settings.link.identity)
    answers = args.verb == "answer"
    # Python has no standard input at all where it was closed.
    if answers and not args.yes and not (sys.stdin and sys.stdin.isatty()):
        raise ConfigError(
            "nobody can accept the call, as there is no terminal: add --yes to accept "
            "whoever has the code"
        )
    said = args.code if answers else [args.code]
    if not said:
        said = [_ask_code()]
    args.code = code_as_shown(said)
    identity = _identity(folder)
    spoken = args.code[:1].isdigit()
    # Under a name, what each call makes of its secret is kept.
    kept = args.remember or (args.code if not spoken else "")
    secrets = _secrets_of(folder, args.code) if args.code and not spoken else ()
    role: Role | Literal[""] = args.role or ("" if answers else "operator")
    name = re.sub(r"[^\w.+-]", "-", identity.name, flags=re.ASCII)[:64] or "unnamed"
    plan = Plan(
        settings.call,
        answers,
        args.code if spoken else "",
        secrets,
        name,
        identity.fingerprint,
        role,
        expected=_fingerprint_of(folder, args.code) if secrets else "",
    )
    prepare = partial(prepare_passing, settings.process.priority)
    with (
        left_by_sigterm(),
        CallProcess(plan, prepare=prepare) as process,
        _LiveSide(args, settings, process) as side,
    ):
        side.begin(role or "robot")
        steps = process.steps()
        found = find_other_end(process, steps, args, side, folder)
        if kept:
            _remember(folder, kept, found)
        failures: list[str] = []
        for work in (
            partial(report_changes, steps, found, failures),
            partial(hang_up_if_forgotten, settings, found),
        ):
            threading.Thread(target=work, daemon=True).start()
        code = live.follow(
            args, side.settings, side.started(), side.name, microphone=side.microphone
        )
        return 1 if failures else code


def code_as_shown(said: Sequence[str]) -> str:
    """Return a code as `tactophone call` shows it, from how a person says or types it;
    a name as it is.

    Raises `ConfigError` if it begins like a code, but is not a code.

    >>> code_as_shown(["3", "Escapade", "peachy"]), code_as_shown(["3 escapade peachy"])
    ('3-escapade-peachy', '3-escapade-peachy')
    >>> code_as_shown(["lab"])
    'lab'
    """
    text = " ".join(said).strip()
    if not text[:1].isdigit():
        return text
    words = [word for word in re.split(r"[\s,._-]+", text.lower()) if word]
    is_code = (
        len(words) == 3
        and words[0].isdecimal()
        and all(re.fullmatch(r"[a-z]+", word) for word in words[1:])
    )
    if not is_code:
        raise ConfigError(
            f"{text!r} is no code: a code is a number and two words, such as "
            "3-escapade-peachy"
        )
    return "-".join(words)


def find_other_end(
    process: "CallProcess",
    steps: "Iterator[tuple[Step, Any]]",
    args: argparse.Namespace,
    side: "_LiveSide",
    folder: Path,
) -> "Found":
    """Show the code, ask the person whether to accept, and return the other end once it
    can be reached."""
    for step, content in steps:
        if step == "code" and not args.code:
            output.note(f"your code: {content}")
            output.log().print(
                "on the other machine: tactophone answer, and this code",
                style="dim",
                soft_wrap=True,
            )
        elif step == "code":
            output.log().print("waiting for the other end ...", style="dim")
        elif step == "asked":
            caller, role, version, fingerprint = content
            output.note(
                f"{caller} calls, the {role}, with tactophone {version}; "
                f"{_known(folder, fingerprint)}"
            )
            side.begin("operator" if role == "robot" else "robot")
            if forgotten := _forgotten_meanwhile(folder, args.code, fingerprint):
                output.warn(forgotten)
            process.answer(not forgotten and (args.yes or _accepts()))
        elif step == "found":
            if forgotten := _forgotten_meanwhile(
                folder, args.code, content.fingerprint
            ):
                raise ConfigError(forgotten)
            output.note(
                f"{content.name}: {_route(content)}; you are the {content.role}"
            )
            return content  # type: ignore[no-any-return]
    raise ConfigError("there is no other end")


def _ask_code() -> str:
    """Ask for the code: what stands after the verb is open to every user of the
    machine, who could use it first."""
    said = ""
    if sys.stdin:
        with suppress(EOFError):
            said = input("code: ")
    if not said.strip():
        raise ConfigError(
            "there is no code: type it where you are asked for it, as `tactophone "
            "call` shows it there"
        )
    return said


def _accepts() -> bool:
    """Ask whether to accept the call; Ctrl-C and the end of the input decline, so that
    the caller is told."""
    try:
        return input("accept? [y/N] ").strip().lower() in ("y", "yes")
    except (EOFError, KeyboardInterrupt):
        return False


def _known(folder: Path, fingerprint: str) -> str:
    from tactophone.net.link.identity import Peers

    name = next(
        (name for name, pin in Peers.load(folder).items() if pin == fingerprint), ""
    )
    if name:
        return f"you trust its key, as {name}"
    return f"its key is new to this machine: {fingerprint[:11]}..."


def _route(found: "Found") -> str:
    how = "over the relay" if found.relayed else f"directly to {found.host}"
    there_and_back = (
        f", {1000 * found.round_trip:.0f} ms there and back"
        if math.isfinite(found.round_trip)
        else ""
    )
    return f"connected {how} in {found.after:.1f} s, encrypted{there_and_back}"


def report_changes(
    steps: "Iterator[tuple[Step, Any]]", found: "Found", failures: list[str]
) -> None:
    """Report each new route and what the other end is doing. Once no route is left, end
    the run as SIGTERM does."""
    other = "operator" if found.role == "robot" else "robot"
    doing = "opening its microphones" if other == "robot" else "opening its output"
    words = {
        "starting": f"still starting; {found.name} says when it is ready",
        "opening": doing,
        "ready": "ready",
    }
    try:
        for step, content in steps:
            if step == "state":
                output.note(f"the {other} is {words[content]}")
            else:
                output.note(f"the route was lost; {_route(content)}")
    except TactophoneError as error:
        failures.append(str(error))
        output.warn(failures[0])
        os.kill(os.getpid(), signal.SIGTERM)


def hang_up_if_forgotten(settings: Settings, found: "Found") -> None:
    """End the run, as SIGTERM does, once the other end is taken out of the trusted
    peers. One that was never among them is trusted for this call alone."""
    from tactophone.live.runtime.held_files import FILES_INTERVAL, HeldPeers
    from tactophone.net.link.identity import Peers, identity_folder

    name = ""
    warned = ""
    forgotten = False

    def heed(peers: Peers) -> None:
        nonlocal name, forgotten
        before = name
        name = peers.name_of(found.fingerprint) or ""
        if before and not name:
            forgotten = True
            os.kill(os.getpid(), signal.SIGTERM)
            output.note(f"{before} is no longer trusted: this machine hangs up")

    held = HeldPeers(settings, heed)
    # Where the file is of no use, `pair forget` says so.
    with suppress(ConfigError):
        heed(Peers.load(identity_folder(settings.link.identity)))
    while not forgotten:
        time.sleep(FILES_INTERVAL)
        problem = "; ".join(fault.text for fault in held.look())
        if problem and problem != warned:
            output.warn(problem)
        warned = problem


class _LiveSide(AbstractContextManager["_LiveSide", None]):
    """The live side, which starts while the other end is searched for; a context
    manager."""

    def __init__(
        self, args: argparse.Namespace, settings: Settings, process: "CallProcess"
    ) -> None:
        from tactophone.net.link.call_socket import PEER

        self._args = args
        self._process = process
        self._agent = process.agent
        self._say = process.say
        self._role = ""
        self.name = settings.process.name or args.verb
        self.settings = change(
            settings,
            [
                "link.peer=[{}]:{}".format(*PEER),
                "rendering.muted=true",
                f"process.name={self.name}",
            ],
        )
        self.microphone: Connection | None = None
        self._resources = ExitStack()

    def __exit__(self, *_: object) -> None:
        self._resources.close()

    def begin(self, role: "Role") -> None:
        if role == self._role:
            return
        self._resources.close()
        self._role = role
        open_source = None
        if role == "robot":
            open_source, self.microphone = sources.source_of(
                self.settings, page=page.wanted(self._args, self.settings)
            )
        self._supervisor = runs.open_side(
            self.settings,
            self.name,
            open_source,
            report=output.note,
            agent=self._agent,
        )
        self._supervisor.progress = lambda doing: (
            self._say("opening") if doing.startswith("opening") else None
        )
        self._resources.push(self._supervisor)
        self._supervisor.begin()

    @contextmanager
    def started(self) -> "Iterator[Sequence[Supervisor]]":
        """Wait until the side runs, and yield it. It ends with the block, and then the
        call: what shows the side ends afterwards, which may take a minute."""
        try:
            with self._resources:
                self._supervisor.await_start()
                self._say("ready")
                yield (self._supervisor,)
        finally:
            self._process.end()


def _identity(folder: Path) -> "Identity":
    """Return this machine's identity; a first call makes it."""
    from tactophone.net.link.identity import KEY_FILE, Identity

    if not (folder / KEY_FILE).exists():
        Identity.create(socket.gethostname()).save(folder)
    return Identity.load(folder)


def _secret_path(folder: Path, name: str) -> Path:
    if not re.fullmatch(r"[A-Za-z][\w.+-]{0,63}", name, flags=re.ASCII):
        raise ConfigError(
            f"{name!r} is neither a code, such as 3-escapade-peachy, nor a name: "
            "letters first, no spaces"
        )
    return folder / "calls" / name


def _secrets_of(folder: Path, name: str) -> tuple[bytes, ...]:
    """Return the secret of the last call with an end, and the one before it: the other
    end may have missed the last one."""
    path = _secret_path(folder, name)
    with suppress(OSError, ValueError):
        if secrets := tuple(map(bytes.fromhex, path.read_text().split())):
            return secrets
    raise ConfigError(
        f"{path} holds no secret of an earlier call: call once with a code and "
        f"--remember {name}"
    )


def _fingerprint_of(folder: Path, name: str) -> str:
    from tactophone.net.link.identity import Peers

    if found := dict(Peers.load(folder).items()).get(name):
        return found
    raise ConfigError(_not_trusted(name))


def _forgotten_meanwhile(folder: Path, name: str, fingerprint: str) -> str:
    """Return that an end, which was called by its name, has been forgotten while it was
    waited for; empty if it was not, or if it has a code instead of a name."""
    from tactophone.net.link.identity import Peers

    if not name or name[0].isdigit() or Peers.load(folder).name_of(fingerprint):
        return ""
    return _not_trusted(name)


def _not_trusted(name: str) -> str:
    return (
        f"{name} is not trusted any more: call once with a code and --remember {name}"
    )


def _remember(folder: Path, name: str, found: "Found") -> None:
    """Trust the other end from now on, and keep the secrets from which both derive the
    next code."""
    from tactophone.net.link.identity import Peers, write_private

    if (
        dict(Peers.load(folder).items()).get(name, found.fingerprint)
        != found.fingerprint
    ):
        output.warn(
            f"not remembered: {name} is the name of another machine in peers.txt; "
            "choose another name"
        )
        return
    path = _secret_path(folder, name)
    draft = path.with_name(f".{name}.{secrets.token_hex(4)}")
    try:
        path.parent.mkdir(mode=0o700, parents=True, exist_ok=True)
        write_private(draft, "\n".join(found.secrets).encode())
        draft.replace(path)
        Peers.load(folder).trusting(name, found.fingerprint).save(folder)
    except OSError as error:
        # What was remembered before still serves the next call.
        output.warn(f"not remembered: {folder}: {error.strerror}; the call goes on")
        return
    output.note(
        f"remembered: `tactophone call {name}` and `tactophone answer {name}` need no "
        "code"
    )
