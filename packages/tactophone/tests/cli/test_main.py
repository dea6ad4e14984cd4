import io
import re
import shlex
import subprocess
import sys
from pathlib import Path

import pytest
import soundfile

from tactophone.cli import main, output
from tactophone.cli.verbs import LABORATORY, all_verbs


def test_version_and_help_exit_with_zero(capsys: pytest.CaptureFixture[str]) -> None:
    for flag in ("--version", "--help"):
        with pytest.raises(SystemExit) as stop:
            main([flag])
        assert stop.value.code == 0
    printed = capsys.readouterr().out
    assert "tactophone" in printed
    assert "open_pipeline" not in printed  # the example of the package is for Python


def test_an_unknown_verb_is_a_usage_error() -> None:
    with pytest.raises(SystemExit) as stop:
        main(["telephone"])
    assert stop.value.code == 2


def test_the_help_begins_with_what_it_is_in_one_sentence(
    capsys: pytest.CaptureFixture[str],
) -> None:
    with pytest.raises(SystemExit):
        main(["--help"])
    before = capsys.readouterr().out.partition("options:")[0]
    whole = " ".join(before.split("VERB ...")[1].split())
    assert whole == (
        "A telephone for touch: microphones on a robot's fingertip, vibration on an "
        "operator's."
    )


@pytest.mark.slow
@pytest.mark.parametrize("closed", [">/dev/full", ">&-"])
def test_output_that_cannot_be_written_is_reported_in_one_line(closed: str) -> None:
    command = f"{shlex.quote(sys.executable)} -m tactophone settings {closed}"
    done = subprocess.run(
        command, shell=True, stderr=subprocess.PIPE, text=True, check=False
    )
    if closed == ">&-":
        assert (done.returncode, done.stderr) == (0, "")
    else:
        assert (done.returncode, done.stderr) == (
            1,
            "tactophone: cannot read or write: No space left on device; free some "
            "space, or write elsewhere\n",
        )


@pytest.mark.parametrize("verb", ["feel", "demo", "simulate competition"])
def test_a_folder_for_results_that_cannot_be_made_is_named(
    verb: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    (tmp_path / "file").touch()
    out = (
        [str(tmp_path / "file")]
        if verb == "simulate competition"
        else ["--out", str(tmp_path / "file")]
    )
    assert main([*verb.split(), *(["a.wav"] if verb == "feel" else []), *out]) == 1
    assert (
        f"{tmp_path / 'file'}: cannot be made (File exists); name a folder of your own"
        in capsys.readouterr().err
    )


def test_a_sound_file_on_a_full_disk_is_one_line(
    capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    def run(_: object) -> int:
        raise soundfile.LibsndfileError(2, "Error opening 'demo/vibration.wav': ")

    monkeypatch.setattr("tactophone.cli.devices.run", run, raising=False)
    assert main(["settings"]) == 1
    (line,) = capsys.readouterr().err.splitlines()
    assert "demo/vibration.wav" in line
    assert "is the disk full?" in line


def printed(words: str, capsys: pytest.CaptureFixture[str]) -> str:
    with pytest.raises(SystemExit):
        main(words.split())
    return capsys.readouterr().out


def test_the_help_explains_some_verbs_and_names_most_but_all_explains_each(
    capsys: pytest.CaptureFixture[str],
) -> None:
    short, everything = printed("--help", capsys), printed("--help all", capsys)
    verbs = all_verbs().values()
    newcomers = {verb.name for verb in verbs if verb.newcomer}
    unwrapped = " ".join(short.split())
    assert {verb.name for verb in verbs if verb.line in unwrapped} == newcomers
    named = set(re.findall(r"[a-z-]+", short.partition("--help all")[2]))
    special = {verb.name for verb in verbs if verb.special}
    assert all_verbs().keys() - newcomers - named == special
    unwrapped = " ".join(everything.split())
    assert all(verb.line in unwrapped for verb in verbs)


def test_without_the_laboratory_each_of_its_verbs_says_what_to_install(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setattr("tactophone.core.plugins.registered", lambda group: [])
    all_verbs.cache_clear()
    try:
        for name in LABORATORY:
            assert main([name]) == 1
            said = capsys.readouterr().err
            assert "pip install './packages/tactophone-lab" in said
    finally:
        all_verbs.cache_clear()


def test_a_verb_shows_six_options_and_all_on_request(
    capsys: pytest.CaptureFixture[str],
) -> None:
    short, everything = (
        printed("receive --help", capsys),
        printed("receive --help all", capsys),
    )
    shown, each = (
        set(re.findall(r"^  (--[a-z]+)", text, re.MULTILINE))
        for text in (short, everything)
    )
    assert len(shown) == 6
    assert {"--tip", "--model", "--dashboard"} < shown < each
    assert f"{len(each) - 6} more options: `tactophone receive --help all`" in short
    assert "more options" not in everything


class Screen(io.StringIO):
    """A terminal, as a program that writes to it sees it."""

    def isatty(self) -> bool:
        return True


@pytest.fixture
def forced_colour(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("FORCE_COLOR", "1")


def test_a_line_that_is_replaced_leaves_nothing_of_it_on_a_terminal(
    monkeypatch: pytest.MonkeyPatch, forced_colour: None
) -> None:
    """A pipe that wants colour, as in a notebook, gets each line and none twice."""
    for screen, shown in (
        (
            Screen(),
            "still starting (5 s)\r\x1b[2Kstill starting (10 s)\r\x1b[2Karmed\n",
        ),
        (io.StringIO(), "still starting (5 s)\nstill starting (10 s)\narmed\n"),
    ):
        console = output._Console(file=screen, highlight=False)
        monkeypatch.setattr(output, "log", lambda console=console: console)
        for line in ("still starting (5 s)\r", "still starting (10 s)\r", "armed"):
            output.note(line)
        assert screen.getvalue() == shown


def test_a_pipe_that_wants_colour_gets_no_progress_bar(
    monkeypatch: pytest.MonkeyPatch, forced_colour: None
) -> None:
    pipe = io.StringIO()
    console = output._Console(file=pipe, highlight=False)
    monkeypatch.setattr(output, "log", lambda: console)
    with output.progress("training", 3) as update:
        update(advance=1)
    assert pipe.getvalue() == ""
