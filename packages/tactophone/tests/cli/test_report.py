"""A report of a problem says what a maintainer asks for, and nothing that is secret."""

import json
from pathlib import Path

import numpy as np
import pytest
import soundfile

from tactophone.app.report import ADDRESS
from tactophone.cli import main
from tactophone.core.version import __version__
from tactophone.live.log.mcap import FORMAT, McapLog
from tactophone.live.telemetry.layout import Fault, RunState
from tactophone.live.telemetry.writer import Telemetry
from tactophone.net.link.identity import Peers


def test_a_report_names_versions_changed_settings_and_notes_but_no_secret(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    sound = np.random.default_rng(0).normal(0, 0.05, (2 * 48000, 2))
    soundfile.write(tmp_path / "a.wav", sound, 48000)
    content = (tmp_path / "a.wav").read_bytes()
    (tmp_path / "a.wav").write_bytes(content[: len(content) // 2])
    out = tmp_path / "report.md"
    command = ["report", "--recording", str(tmp_path / "a.wav"), "--out", str(out)]
    command += ["--set", "detector.margin_db=7", "--set", "link.port=48999"]
    assert main(command) == 0
    text = out.read_text(encoding="utf-8")
    assert f"tactophone {__version__}" in text
    assert "detector.margin_db = 7" in text
    assert "link.port = (changed)" in text
    assert "48999" not in text
    assert "ends after 1.0 of 2.0 s" in text
    assert out.stat().st_mode & 0o777 == 0o600


def log_of(path: Path, *messages: tuple[str, bytes]) -> Path:
    """Write a log of one chunk as a stranger might."""
    from mcap.writer import Writer

    with path.open("wb") as file:
        writer = Writer(file, chunk_size=1 << 40)
        writer.start(profile=FORMAT, library="x")
        schema = writer.register_schema("x", "jsonschema", b"{}")
        for topic, data in messages:
            channel = writer.register_channel(topic, "json", schema, {})
            writer.add_message(channel, 0, data, 0)
        writer.finish()
    return path


@pytest.mark.parametrize(
    ("topic", "data", "said"),
    [
        ("/tactophone/health", bytes(80 << 20), "a chunk of over 64 MB"),
        ("/tactophone/health", b"[" * 200_000, "a message cannot be read"),
        (
            "/tactophone/health",
            b'{"gauges": {}, "counters": {"a": 1%s}}' % (b"0" * 400),
            "a message cannot be read",
        ),
        ("/tactophone/health", b"[]", "a message cannot be read"),
        ("/tactophone/events", b'{"level": 9, "message": ["x"]}', "cannot be read"),
        ("/tactophone/run", b'{"role": "robot", "versions": [1]}', "cannot be read"),
    ],
)
def test_a_log_from_anywhere_is_summarized_within_bounds(
    topic: str, data: bytes, said: str, tmp_path: Path
) -> None:
    log = log_of(tmp_path / "a.mcap", (topic, data))
    out = tmp_path / "report.md"
    assert main(["report", "--log", str(log), "--out", str(out)]) == 0
    assert said in out.read_text(encoding="utf-8")


def test_a_logs_counters_and_warnings_are_summarized(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    name = f"test-{tmp_path.name}"
    log = tmp_path / "a.mcap"
    gone = Fault("actuator", "the JACK server is gone: start it again")
    with Telemetry(name) as telemetry, McapLog(name, log) as written:
        telemetry.count("packets_lost", 7)
        for faults in ((), (gone,), (), (gone,)):
            telemetry.update(
                RunState("operator", link="receiving from hand.local", faults=faults),
                now=0.0,
            )
            written.read()
    out = tmp_path / "report.md"
    assert main(["report", "--log", str(log), "--out", str(out)]) == 0
    text = out.read_text(encoding="utf-8")
    assert "- packets_lost: 7" in text
    assert "- 2 x from 0.0 s on: the JACK server is gone" in text
    assert "hand.local" not in text


def test_a_report_names_no_other_machine(tmp_path: Path) -> None:
    keys = tmp_path / "keys"
    known = Peers({"ab" * 32: "alices-robot"})
    known.save(keys)
    warnings = [
        "no operator at lab.example.org:48470 yet: start `tactophone receive` there",
        "'alices-robot' called too and was sent away",
        "alices-robot hung up",
        "no answer from 192.0.2.7:48470 or [2001:db8::7]:48470",
    ]
    events = [json.dumps({"level": 3, "message": text}).encode() for text in warnings]
    log = log_of(
        tmp_path / "a.mcap", *(("/tactophone/events", event) for event in events)
    )
    out = tmp_path / "report.md"
    command = ["report", "--log", str(log), "--out", str(out)]
    assert main([*command, "--set", f"link.identity={keys}"]) == 0
    text = out.read_text(encoding="utf-8")
    assert "another machine called too and was sent away" in text
    for private in ("lab.example", "alices", "192.0.2", "2001:db8"):
        assert private not in text


def test_an_address_is_told_from_other_words_with_a_colon() -> None:
    for text in (
        "the JACK server is gone: start it again",
        "at 12:30",
        "std::cout",
        "a: b",
    ):
        assert not ADDRESS.search(text)


@pytest.mark.parametrize("name", ["log", "recording"])
def test_a_report_is_not_written_over_what_it_reads(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    read = tmp_path / "mine"
    read.write_bytes(b"mine")
    assert main(["report", f"--{name}", str(read), "--out", str(read)]) == 1
    assert f"the {name} itself" in capsys.readouterr().err
    assert read.read_bytes() == b"mine"
