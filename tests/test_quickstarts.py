"""Runs the commands of docs/quickstart as they stand; the simulated finger replaces
what a test does not have."""

import re
import shlex
import signal
import ssl
import subprocess
import sys
import urllib.request
from pathlib import Path

import pytest

from tactophone.cli import main
from tactophone.net.link.identity import Identity
from tests.live.runtime.live_system import free_port

PAGES = Path(__file__).parent.parent / "docs" / "quickstart"


def commands(page: str) -> list[tuple[str, list[str]]]:
    """Each command of a page with its machine: robot, operator, or an empty text."""
    blocks = re.findall(
        r"```console\n(.*?)```", (PAGES / page).read_text(), flags=re.DOTALL
    )
    found = re.findall(
        r"^(\w*)\$ tactophone (.+)$", "\n".join(blocks), flags=re.MULTILINE
    )
    return [(machine, shlex.split(words)) for machine, words in found]


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
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    assert {words[0] for _, words in commands("researcher.md")} == {
        "simulate",
        "dataset",
        "feel",
        "evaluate",
        "train",
    }
    for _, words in commands("researcher.md"):
        assert main(words) == 0, words
    assert (tmp_path / "wiggle.feel.png").is_file()
    assert capsys.readouterr().out.count("area under ROC curve") >= 3


@pytest.mark.slow
def test_the_code_of_the_python_page_prints_what_the_page_shows(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.chdir(tmp_path)
    for _, words in commands("python.md"):
        assert main(words) == 0, words
    capsys.readouterr()
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
    ((_, serve),) = commands("phone.md")
    extra = ["--name", "quickstart-phone"]
    with start([*serve, *extra], cwd=tmp_path) as process:
        assert process.stdout
        address = next(
            line.split()[1] for line in process.stdout if line.startswith("page: ")
        )
        trusting = ssl.SSLContext(ssl.PROTOCOL_TLS_CLIENT)
        trusting.check_hostname, trusting.verify_mode = False, ssl.CERT_NONE
        with urllib.request.urlopen(address, context=trusting, timeout=20) as answer:
            page = answer.read().decode()
        process.send_signal(signal.SIGINT)
        process.communicate(timeout=20)
    assert address.startswith("https://")
    assert "Use this microphone" in page
    assert "Feel it here" in page


@pytest.mark.realtime
def test_a_lab_pairs_runs_and_replays(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """Each machine is a folder; `setup` listens for 2 s, and the run lasts until the
    robot has sent for 4 s."""
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
    operator = None
    for machine, shown in commands("lab.md"):
        words = [word.replace("operator.local", f"127.0.0.1:{port}") for word in shown]
        words.extend(stand_in.get(shown[0], []))
        if shown[0] == "pair":
            words.extend(["--identity", str(tmp_path / machine)])
        if shown[:2] == ["pair", "trust"]:
            words[3] = Identity.load(tmp_path / words[2]).fingerprint
        if shown[0] in ("send", "receive"):
            words.extend(["--set", f"link.identity={tmp_path / machine}"])
        if words[0] == "receive":
            operator = start(words, cwd=tmp_path)
            continue
        assert main(words) == 0, words
        if words[0] == "send":
            assert operator
            operator.send_signal(signal.SIGTERM)
            assert "encrypted" in operator.communicate(timeout=20)[0]
    assert capsys.readouterr().out.count("equal to the bit") == 2


def test_readme_prints_what_the_python_page_prints() -> None:
    """The page's figure is run above; README's example has the same sound."""
    shown = re.search(
        r"contact \d+%, of which rough \d+%", (PAGES / "python.md").read_text()
    )
    assert shown is not None
    assert f"It prints `{shown[0]}`" in (PAGES.parent.parent / "README.md").read_text()
