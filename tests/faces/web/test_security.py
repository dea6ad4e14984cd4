"""Access by token, Host and Origin."""

import pytest

from tactophone.faces.web.security import HEADERS, AccessControl

ACCESS = AccessControl("127.0.0.1", 8470, token="secret")


@pytest.mark.parametrize("host", ["127.0.0.1:8470", "localhost:8470", "LOCALHOST:8470", "[::1]:8470", "127.1.2.3:8470"])
def test_this_machine_by_any_of_its_names_passes(host: str) -> None:
    assert ACCESS.refusal(token="secret", host=host, origin=None) == ""
    assert ACCESS.refusal(token="secret", host=host, origin=f"http://{host}", websocket=True) == ""


@pytest.mark.parametrize("token", ["", "Secret", "secret2", "sécret"])
def test_a_wrong_token_is_refused(token: str) -> None:
    assert "token" in ACCESS.refusal(token=token, host="127.0.0.1:8470", origin=None)


@pytest.mark.parametrize(
    "host",
    [
        *(None, "", "rebound.example:8470", "127.0.0.1", "127.0.0.1:80", "127.0.0.1:8470.example:8470"),
        *("127.0.0.1.example:8470", "192.168.0.7:8470", "localhost.:8470", "[::1", "localhost:port"),
    ],
)
def test_a_rebound_name_is_refused(host: str | None) -> None:
    assert "Host" in ACCESS.refusal(token="secret", host=host, origin=None)


@pytest.mark.parametrize(
    "origin", ["http://evil.example", "https://127.0.0.1:8470", "http://127.0.0.1:8471", "null", ""]
)
def test_another_pages_origin_is_refused(origin: str) -> None:
    assert "Origin" in ACCESS.refusal(token="secret", host="127.0.0.1:8470", origin=origin, websocket=True)


def test_a_websocket_without_an_origin_is_no_browsers_and_is_refused() -> None:
    assert "Origin" in ACCESS.refusal(token="secret", host="127.0.0.1:8470", origin=None, websocket=True)


def test_listening_everywhere_passes_addresses_in_figures_but_no_foreign_name() -> None:
    access = AccessControl("0.0.0.0", 8470, token="secret")
    assert access.refusal(token="secret", host="192.168.0.7:8470", origin=None) == ""
    assert access.refusal(token="secret", host="rebound.example:8470", origin=None)


def test_the_token_is_long_new_each_time_and_not_in_the_repr() -> None:
    first, second = AccessControl("127.0.0.1", 1), AccessControl("127.0.0.1", 1)
    assert first.token != second.token
    assert len(first.token) >= 32
    assert first.token not in repr(first)


def test_nothing_but_the_page_itself_may_run_or_be_loaded() -> None:
    policy = HEADERS["Content-Security-Policy"]
    assert policy.startswith("default-src 'none'")
    assert "unsafe" not in policy
    assert "http" not in policy
