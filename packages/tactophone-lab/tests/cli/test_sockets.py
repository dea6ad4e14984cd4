"""No verb opens a socket that docs/reference/threat-model.md does not name."""

import contextlib
import functools
import json
import os
import re
import runpy
import shutil
import signal
import subprocess
import sys
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import psutil
import pytest
import soundfile

from tactophone.cli.verbs import all_verbs
from tests.folders import audiofolder

pytestmark = pytest.mark.realtime

ROOT = Path(__file__).parents[4]

WORDS: dict[str, list[str]] = runpy.run_path(str(ROOT / "tests" / "test_package.py"))[
    "WORDS"
]

LONG = {
    "demo",
    "play",
    "latency",
    "setup",
    "record",
    "simulate",
    "train",
    "finetune",
    "benchmark",
}
"""Verbs that take half a minute or more, or wait for a person: they are ended by Ctrl+C
after `MOMENT`."""

MOMENT = 12.0
"""Seconds in which each has opened what it opens, also under strace."""

HOOK = """
import json, os, socket, sys

def note(event, arguments, log=os.environ["SOCKETS"]):
    if event not in ("socket.bind", "socket.connect", "socket.sendto", "socket.sendmsg",
                     "socket.getaddrinfo"):
        return
    if event == "socket.getaddrinfo":
        entry = ["name", str(arguments[0])]
    else:
        opened, address = arguments
        if opened.family not in (socket.AF_INET, socket.AF_INET6) or not address:
            return
        kind = "UDP" if opened.type & 0xF == socket.SOCK_DGRAM else "TCP"
        entry = [kind, str(address[0])]
    with open(log, "a") as file:
        file.write(json.dumps(entry) + chr(10))

sys.addaudithook(note)
"""

LOCAL = re.compile(r"(::ffff:)?127\.0\.0\.\d+|::1|localhost|None|")


@dataclass(frozen=True)
class Named:
    """What the page names of a verb: kinds of sockets, and whether this machine alone
    is reached by them."""

    kinds: frozenset[str]
    local: bool


def named_on_the_page() -> dict[str, Named]:
    text = (ROOT / "docs" / "reference" / "threat-model.md").read_text("utf-8")
    _, _, section = text.partition("## Sockets\n")
    section, _, _ = section.partition("\n## ")
    found = {}
    for row in section.splitlines():
        if not row.startswith("| `"):
            continue
        _, verbs, sockets, _ = row.split("|", 3)
        kinds = frozenset(re.findall(r"\b(?:UDP|TCP)\b", sockets))
        named = Named(kinds, "127.0.0.1" in sockets)
        found |= dict.fromkeys(re.findall(r"`([a-z-]+)`", verbs), named)
    return found


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A working folder with what the verbs ask for, and the hook."""
    folder = tmp_path_factory.mktemp("work")
    audiofolder(folder / "set")
    random = np.random.default_rng(0)
    soundfile.write(
        folder / "finger.wav", random.normal(scale=0.1, size=(24_000, 2)), 48_000
    )
    np.save(folder / "heights.npy", random.normal(scale=1e-6, size=1000))
    (folder / "hook").mkdir()
    (folder / "hook" / "sitecustomize.py").write_text(HOOK)
    return folder


@functools.cache
def run(folder: Path, verb: str) -> tuple[set[tuple[str, str]], str]:
    """Run a verb; return the sockets that Python saw, and what strace saw of all, if it
    is installed."""
    log, trace = folder / f"{verb}.sockets", folder / f"{verb}.trace"
    log.touch()
    path = os.pathsep.join([str(folder / "hook"), os.environ["PYTHONPATH"]])
    command = [sys.executable, "-P", "-m", "tactophone", verb, *WORDS[verb]]
    if shutil.which("strace"):
        # With the filter only what is traced stops the verb.
        calls = ["strace", "-f", "--seccomp-bpf", "-qq", "-e", "trace=socket"]
        calls += ["-o", str(trace)]
        command = [*calls, *command]
    process = subprocess.Popen(
        command,
        cwd=folder,
        env={
            **os.environ,
            "HOME": str(folder),
            "PYTHONPATH": path,
            "SOCKETS": str(log),
        },
        stdin=subprocess.DEVNULL,
        stdout=subprocess.DEVNULL,
        stderr=subprocess.DEVNULL,
        start_new_session=True,
    )
    try:
        with contextlib.suppress(subprocess.TimeoutExpired):
            process.wait(MOMENT if verb in LONG else 120)
        if process.poll() is None:
            _interrupt(process.pid, traced=trace.exists())
            # One that computes may take longer to end; its sockets are seen by then.
            with contextlib.suppress(subprocess.TimeoutExpired):
                process.wait(10)
    finally:
        with contextlib.suppress(ProcessLookupError):
            os.killpg(process.pid, signal.SIGKILL)
    seen = {tuple(json.loads(line)) for line in log.read_text().splitlines()}
    return seen, trace.read_text(errors="replace") if trace.exists() else ""


def _interrupt(pid: int, *, traced: bool) -> None:
    """Press Ctrl+C for the verb; strace would end at it before the verb has."""
    (verb,) = psutil.Process(pid).children() if traced else [psutil.Process(pid)]
    verb.send_signal(signal.SIGINT)


@pytest.mark.parametrize("verb", sorted(WORDS))
def test_a_verb_opens_no_socket_that_the_page_does_not_name(
    folder: Path, verb: str
) -> None:
    named = named_on_the_page().get(verb, Named(frozenset(), local=True))
    seen, trace = run(folder, verb)
    assert {kind for kind, _ in seen} <= named.kinds | {"name"}
    if named.local:
        assert {host for _, host in seen if not LOCAL.fullmatch(host)} == set()
    # A library in C opens its sockets behind Python's back.
    if not named.kinds:
        assert re.findall(r"socket\(AF_INET.*", trace) == []


def test_the_page_names_verbs_that_there_are() -> None:
    assert named_on_the_page().keys() <= all_verbs().keys()


def test_the_hook_sees_what_a_verb_opens(folder: Path) -> None:
    seen, _ = run(folder, "loopback")
    assert ("UDP", "127.0.0.1") in seen
