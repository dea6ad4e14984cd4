"""Access by token, Host and Origin."""

import pytest

from tactophone.faces.web.security import HEADERS, AccessControl

ACCESS = AccessControl("127.0.0.1", 8470, token="secret")


@pytest.mark.parametrize(
    "host",
    [
        "127.0.0.1:8470",
        "localhost:8470",
        "LOCALHOST:8470",
        "[::1]:8470",
        "127.1.2.3:8470",
    ],
)
def test_this_machine_by_any_of_its_names_passes(host: str) -> None:
    assert ACCESS.refusal(token="secret", host=host, origin=None) == ""
    assert (
        ACCESS.refusal(
            token="secret", host=host, origin=f"http://{host}", websocket=True
        )
        == ""
    )


@pytest.mark.parametrize("token", ["", "Secret", "secret2", "sécret"])
def test_a_wrong_token_is_refused(token: str) -> None:
    assert "token" in ACCESS.refusal(token=token, host="127.0.0.1:8470", origin=None)


@pytest.mark.parametrize(
    "host",
    [
        *(
            None,
            "",
            "rebound.example:8470",
            "127.0.0.1",
            "127.0.0.1:80",
            "127.0.0.1:8470.example:8470",
        ),
        *(
            "127.0.0.1.example:8470",
            "192.168.0.7:8470",
            "localhost.:8470",
            "[::1",
            "localhost:port",
        ),
    ],
)
def test_a_rebound_name_is_refused(host: str | None) -> None:
    assert "Host" in ACCESS.refusal(token="secret", host=host, origin=None)


@pytest.mark.parametrize(
    "origin",
    [
        "http://evil.example",
        "https://127.0.0.1:8470",
        "http://127.0.0.1:8471",
        "null",
        "",
    ],
)
def test_another_pages_origin_is_refused(origin: str) -> None:
    assert "Origin" in ACCESS.refusal(
        token="secret", host="127.0.0.1:8470", origin=origin, websocket=True
    )


def test_a_websocket_without_an_origin_is_no_browsers_and_is_refused() -> None:
    assert "Origin" in ACCESS.refusal(
        token="secret", host="127.0.0.1:8470", origin=None, websocket=True
    )


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


def test_every_answer_forbids_sniffing_caching_and_other_pages_and_hides_url() -> None:
    assert {
        name: value
        for name, value in HEADERS.items()
        if name != "Content-Security-Policy"
    } == {
        "X-Content-Type-Options": "nosniff",
        "Referrer-Policy": "no-referrer",
        "Cross-Origin-Opener-Policy": "same-origin",
        "Cross-Origin-Resource-Policy": "same-origin",
        "Cache-Control": "no-store",
    }


def test_the_policy_lets_the_page_load_its_own_parts_and_nobody_frame_it() -> None:
    rules = dict(
        rule.split(" ", 1) for rule in HEADERS["Content-Security-Policy"].split("; ")
    )
    assert {name for name, value in rules.items() if value == "'self'"} == {
        *("script-src", "style-src", "connect-src", "img-src")
    }
    assert {name for name, value in rules.items() if value == "'none'"} == {
        *("default-src", "base-uri", "form-action", "frame-ancestors")
    }


@pytest.mark.parametrize(
    ("host", "private"),
    [
        ("localhost", True),
        ("127.0.0.1", True),
        ("::1", True),
        ("0.0.0.0", False),
        ("192.168.0.7", False),
    ],
)
def test_a_page_is_private_where_only_this_machine_can_reach_it(
    host: str, private: bool
) -> None:
    assert AccessControl(host, 8470).private is private


@pytest.mark.parametrize(
    ("scheme", "port", "other"), [("http", 80, 443), ("https", 443, 80)]
)
def test_an_address_without_a_port_means_the_one_of_its_scheme(
    scheme: str, port: int, other: int
) -> None:
    assert (
        AccessControl("127.0.0.1", port, "secret", scheme).refusal(
            token="secret", host="localhost", origin=None
        )
        == ""
    )
    wrong = AccessControl("127.0.0.1", other, "secret", scheme)
    assert "Host" in wrong.refusal(token="secret", host="localhost", origin=None)


def test_the_machines_own_name_passes_only_where_it_listens_everywhere(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr("socket.gethostname", lambda: "Bench")
    everywhere, here = (
        AccessControl("0.0.0.0", 8470, "secret"),
        AccessControl("127.0.0.1", 8470, "secret"),
    )
    assert everywhere.url == "http://Bench:8470/secret/"
    assert here.url == "http://127.0.0.1:8470/secret/"
    assert AccessControl("::1", 8470, "secret").url == "http://[::1]:8470/secret/"
    assert everywhere.refusal(token="secret", host="bench:8470", origin=None) == ""
    assert "Host" in here.refusal(token="secret", host="bench:8470", origin=None)


def test_a_token_has_24_random_bytes() -> None:
    assert len(AccessControl("127.0.0.1", 1).token) == 32


def test_every_character_of_the_token_counts() -> None:
    access = AccessControl("127.0.0.1", 8470)
    for place in range(len(access.token)):
        other = "A" if access.token[place] != "A" else "B"
        wrong = access.token[:place] + other + access.token[place + 1 :]
        assert access.refusal(token=wrong, host="127.0.0.1:8470", origin=None)
