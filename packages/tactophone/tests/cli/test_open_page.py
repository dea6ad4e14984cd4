"""``--open``: the page's address goes to a browser of this machine, besides being
printed."""

import webbrowser
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import pytest

from tactophone.cli import page
from tactophone.core.settings import Settings, change


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
    opened: list[str] = []

    def open_one(address: str) -> bool:
        opened.append(address)
        return works

    monkeypatch.setattr(webbrowser, "open", open_one)
    access = SimpleNamespace(private=True)
    served: Any = cast(
        Any, SimpleNamespace(url="http://127.0.0.1:1/token/", access=access)
    )
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
