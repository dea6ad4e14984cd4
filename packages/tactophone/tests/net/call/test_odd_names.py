"""A server of a call by a name that no machine can have."""

import asyncio

import pytest

pytest.importorskip("aioice")
from tactophone.net.call.ice import Server


@pytest.mark.parametrize("host", ["a..b", 70 * "x" + ".com"])
def test_it_has_no_address(host: str) -> None:
    """The library's error is no `OSError`."""
    assert asyncio.run(Server(f"{host}:3478").resolve()) is None
