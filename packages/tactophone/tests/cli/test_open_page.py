"""``--open``: the page's address goes to a browser of this machine, besides being
printed."""

import webbrowser
from types import SimpleNamespace
from typing import Any, cast

import pytest

from tactophone.cli import page


@pytest.mark.parametrize("works", [True, False])
def test_the_address_is_opened_and_printed_and_a_machine_without_a_browser_says_so(
    works: bool, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
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
    assert opened == ["http://127.0.0.1:1/token/try"]
    said = capsys.readouterr().err
    assert "page: http://127.0.0.1:1/token/try" in said
    assert ("no browser could be opened" in said) != works
