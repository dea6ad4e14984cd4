"""A verb that is a page opens it in a browser of this machine, where a person sits at
its screen, besides printing its address."""

import argparse
import time
import webbrowser
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest

from tactophone.cli import options, page
from tactophone.core.settings import Settings, change


def sit_at_a_screen(monkeypatch: pytest.MonkeyPatch) -> None:
    for name in ("SSH_CONNECTION", "SSH_TTY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setenv("DISPLAY", ":0")
    monkeypatch.setattr("sys.platform", "linux")


def served_page() -> Any:
    return cast(
        Any,
        SimpleNamespace(
            url="http://127.0.0.1:1/token/",
            access=SimpleNamespace(private=True),
            wait_for_death=lambda: False,
        ),
    )


def test_a_page_whose_process_dies_is_missed_at_the_terminal(
    capsys: pytest.CaptureFixture[str],
) -> None:
    served = served_page()
    served.wait_for_death = lambda: True
    page.announce(served)
    end = time.monotonic() + 5.0
    while "page's process has died" not in (said := capsys.readouterr().err):
        assert time.monotonic() < end, said
        time.sleep(0.01)


@pytest.mark.parametrize(
    ("name", "value"),
    [("SSH_CONNECTION", "192.0.2.1 5 192.0.2.2 22"), ("SSH_TTY", "/dev/pts/1")],
)
def test_over_ssh_no_browser_takes_the_terminal(
    name: str, value: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Also where the screen is forwarded."""
    sit_at_a_screen(monkeypatch)
    monkeypatch.setenv(name, value)
    monkeypatch.setattr(webbrowser, "open", pytest.fail)
    page.announce(served_page(), browser=True)


def test_without_a_screen_the_address_is_only_printed(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    sit_at_a_screen(monkeypatch)
    monkeypatch.delenv("DISPLAY")
    monkeypatch.setattr(webbrowser, "open", pytest.fail)
    page.announce(served_page(), browser=True)
    assert capsys.readouterr().err == "page: http://127.0.0.1:1/token/\n"


def test_a_page_for_a_phone_shows_its_code_and_opens_nothing_here(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    sit_at_a_screen(monkeypatch)
    monkeypatch.setattr(webbrowser, "open", pytest.fail)
    served = served_page()
    served.access = SimpleNamespace(private=False, scheme="https")
    page.announce(served, browser=True)


@pytest.mark.parametrize("verb", ["listen", "play", "try"])
def test_a_verb_that_is_a_page_opens_it_unless_told_not_to(verb: str) -> None:
    parser = argparse.ArgumentParser()
    options.add_settings(parser, verb)
    for words, opens in (([], True), (["--no-open"], False)):
        settings = options.settings_of(parser.parse_args(words))
        assert settings.page.open == opens


def test_a_page_beside_a_run_is_only_asked_for_by_its_own_options() -> None:
    args = argparse.Namespace(dashboard=False)
    assert not page.wanted(args, change(Settings(), ["page.open=false"]))
    assert page.wanted(args, change(Settings(), ["page.lan=true"]))


@pytest.mark.parametrize("works", [True, False])
def test_the_address_is_opened_and_printed_and_a_machine_without_a_browser_says_so(
    works: bool,
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """Every user of a machine sees what a program is started with, so the browser gets
    a file of this user's own, and not the token."""
    monkeypatch.setenv("HOME", str(tmp_path))
    sit_at_a_screen(monkeypatch)
    opened: list[str] = []

    def open_one(address: str) -> bool:
        opened.append(address)
        return works

    monkeypatch.setattr(webbrowser, "open", open_one)
    served = served_page()
    page.announce(served, "try")
    assert opened == []
    page.announce(served, "try", browser=True)
    (given,) = opened
    file = Path(given.removeprefix("file://"))
    assert file.parent == tmp_path
    assert file.stat().st_mode & 0o777 == 0o600
    assert 'content="0; url=http://127.0.0.1:1/token/try"' in file.read_text()
    said = capsys.readouterr().err
    assert "page: http://127.0.0.1:1/token/try" in said
    assert ("no browser could be opened" in said) != works


def test_an_encrypted_page_makes_its_own_certificate_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    monkeypatch.setenv("HOME", str(tmp_path))
    settings = change(Settings(), ["page.https=true"])
    made = page.place(settings)["certificate"]
    assert made is not None
    assert all(path.is_relative_to(tmp_path) and path.exists() for path in made)
    assert "made a certificate for this machine's pages" in capsys.readouterr().err
    written = [path.read_bytes() for path in made]
    assert page.place(settings)["certificate"] == made
    assert [path.read_bytes() for path in made] == written
    assert "made a certificate" not in capsys.readouterr().err
