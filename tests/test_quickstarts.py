"""Runs the commands of docs/quickstart as they stand, and compares what they print with
the pages; the simulated finger replaces what a test does not have."""

import contextlib
import io
import os
import re
import signal
import ssl
import subprocess
import sys
import urllib.request
from pathlib import Path

import pytest

from tactophone.cli import main, output
from tactophone.live.audio.dummy import DummyServer
from tactophone.net.link.identity import IDENTITY_FOLDER, Identity
from tests.live.runtime.live_system import free_port
from tests.shown_output import agree, agree_in_words, examples

PAGES = Path(__file__).parent.parent / "docs" / "quickstart"
PROGRESS = re.compile(r"\d+ of \d+ takes are finished|still starting")
"""Begins lines that a person sees only for a while, or on a busy machine."""


@pytest.fixture(autouse=True)
def width_of_the_pages(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("COLUMNS", "90")


def said_by(words: list[str]) -> list[str]:
    """Run a command in this process; return the lines that a person reads, of both
    streams."""
    for console in (output.out, output.log):
        console.cache_clear()  # it keeps the width that it was made with
    said = io.StringIO()
    with contextlib.redirect_stdout(said), contextlib.redirect_stderr(said):
        code = main(words)
    assert code == 0, (words, said.getvalue())
    return lines(said.getvalue())


def lines(printed: str) -> list[str]:
    """Return what a person reads of an output, by lines."""
    return [line.rstrip() for line in printed.splitlines() if not PROGRESS.match(line)]


def start(words: list[str], **options: str | Path) -> subprocess.Popen[str]:
    return subprocess.Popen(
        [sys.executable, "-m", "tactophone", *words],
        stdout=subprocess.PIPE,
        stderr=subprocess.STDOUT,
        text=True,
        **options,  # type: ignore[call-overload]
    )


@pytest.mark.slow
def test_a_researcher_gets_from_recordings_to_scores(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    steps = list(examples(PAGES / "researcher.md"))
    assert {step.words[0] for step in steps} == {
        "simulate",
        "dataset",
        "feel",
        "evaluate",
        "train",
    }
    for step in steps:
        assert step.shown, step.command
        assert step.unlike(said_by(step.words)) == [], step.command
    assert (tmp_path / "wiggle.feel.png").is_file()


@pytest.mark.slow
def test_the_code_of_the_python_page_prints_what_the_page_shows(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    for step in examples(PAGES / "python.md"):
        assert step.unlike(said_by(step.words)) == [], step.command
    code = re.findall(
        r"```python\n(.*?)```(?:\n\n```text\n(.*?)```)?",
        (PAGES / "python.md").read_text(),
        re.DOTALL,
    )
    names: dict[str, object] = {"__name__": "quickstart"}
    for block, shown in code:
        exec(block, names)
        printed = capsys.readouterr().out
        if "open_live" in block:
            # A machine that stands still loses live sound, so only the form is held.
            assert re.fullmatch(r"(\d\.\d s (none|smooth|rough)\n)+", printed)
        else:
            assert printed == shown, block
    assert sum(bool(shown) for _, shown in code) == 4
    assert (tmp_path / "felt.csv").read_text().count("rough") > 50


@pytest.mark.realtime
def test_the_phones_page_answers_encrypted(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("HOME", str(tmp_path))  # which gets the page's certificate
    (serve,) = examples(PAGES / "phone.md")
    extra = ["--name", "quickstart-phone"]
    printed = ""
    with start([*serve.words, *extra], cwd=tmp_path) as process:
        assert process.stdout
        for line in process.stdout:
            printed += line
            if line.startswith("page: "):
                break
        address = line.split()[1]
        trusting = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
        trusting.check_hostname, trusting.verify_mode = False, ssl.CERT_NONE
        with urllib.request.urlopen(address, context=trusting, timeout=60) as answer:
            page = answer.read().decode()
        process.send_signal(signal.SIGINT)
        printed += process.communicate(timeout=20)[0]
    assert address.startswith("https://")
    assert "Use this microphone" in page
    assert "Feel it here" in page
    seen = lines(printed.replace(str(tmp_path), "/home/you"))
    assert serve.unlike(seen) == []


@pytest.mark.realtime
def test_a_lab_pairs_runs_and_replays(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each machine is a folder, and the sound card a dummy; `setup` listens for 2 s,
    and the run lasts until the robot has sent for 4 s.

    How much a run received, and how late, depends on the machine, so figures are
    compared only where sound is computed from seeds.
    """
    monkeypatch.chdir(tmp_path)
    port = free_port()
    stand_in = {
        "setup": [
            "--source",
            "finger",
            "--set",
            "simulation.gain_db=-20",
            "--seconds",
            "2",
            "--yes",
        ],
        "check": [
            "--source",
            "finger",
            "--set",
            "simulation.gain_db=-20",
            "--yes",
        ],
        "receive": [
            "--actuator",
            "none",
            "--name",
            "quickstart-operator",
            "--set",
            f"link.port={port}",
        ],
        "send": ["--source", "finger", "--name", "quickstart-robot", "--duration", "4"],
    }
    operator = receive = None
    for step in examples(PAGES / "lab.md"):
        verb, *_ = step.words
        words = [
            word.replace("operator.local", f"127.0.0.1:{port}") for word in step.words
        ]
        words.extend(stand_in.get(verb, []))
        identity = tmp_path / step.machine
        if verb == "pair":
            words.extend(["--identity", str(identity)])
        if step.words[:2] == ["pair", "trust"]:
            words[3] = Identity.load(tmp_path / words[2]).fingerprint
        if verb in ("send", "receive"):
            words.extend(["--set", f"link.identity={identity}"])
        if verb == "receive":
            receive, operator = step, start(words, cwd=tmp_path)
            continue
        if verb == "devices":
            assert step.unlike(lines(devices_of_a_dummy_card(words))) == []
            continue
        # A longer folder breaks the line elsewhere.
        monkeypatch.setenv("COLUMNS", "400" if verb == "pair" else "90")
        home = str(Path("/home/you", *IDENTITY_FOLDER.parts[1:]))
        printed = [line.replace(str(identity), home) for line in said_by(words)]
        same = agree if verb in ("setup", "check") else agree_in_words
        assert step.shown, step.command
        assert step.unlike(printed, same) == [], (step.command, printed)
        if verb == "send":
            assert operator
            assert receive
            operator.send_signal(signal.SIGTERM)
            said, _ = operator.communicate(timeout=20)
            assert receive.unlike(lines(said), agree_in_words) == []


def devices_of_a_dummy_card(words: list[str]) -> str:
    """Return what the command prints where JACK runs with its dummy driver."""
    with DummyServer() as server:
        environment = {
            **os.environ,
            "JACK_DEFAULT_SERVER": server.name,
            "COLUMNS": "90",
        }
        done = subprocess.run(
            [sys.executable, "-m", "tactophone", *words],
            env=environment,
            capture_output=True,
            text=True,
            check=True,
        )
    return done.stdout


def test_readme_prints_what_the_python_page_prints() -> None:
    """The page's figure is run above; README's example has the same sound."""
    shown = re.search(
        r"contact \d+%, of which rough \d+%", (PAGES / "python.md").read_text()
    )
    assert shown is not None
    assert f"It prints `{shown[0]}`" in (PAGES.parent.parent / "README.md").read_text()
