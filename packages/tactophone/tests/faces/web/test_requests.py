"""Requests of a page."""

import json

import pytest

from tactophone.faces.web.dashboard import parse_request
from tactophone.live.telemetry.layout import FingerState, Request, RunState

STATE = RunState(
    profiles=("paper", "plain"), fingers=(FingerState(ceiling=0.4, local_ceiling=0.5),)
)


@pytest.mark.parametrize(
    ("entries", "granted"),
    [
        ({"action": "mute"}, Request("mute")),
        ({"action": "stop"}, Request("stop")),
        ({"action": "ceiling", "value": 0.4}, Request("lower_ceiling", 0.4)),
        ({"action": "ceiling", "value": 0}, Request("lower_ceiling", 0.0)),
        ({"action": "output_level", "value": 1}, Request("output_level", 1.0)),
        (
            {"action": "threshold_dbfs", "value": -47.5},
            Request("threshold_dbfs", -47.5),
        ),
        ({"action": "profile", "text": "plain"}, Request("profile", text="plain")),
    ],
)
def test_what_is_in_range_is_passed_on(
    entries: dict[str, object], granted: Request
) -> None:
    assert parse_request(json.dumps(entries), STATE) == granted


@pytest.mark.parametrize(
    "text",
    [
        *(
            "",
            "[]",
            "1",
            "null",
            "mute",
            '{"value": 1}',
            '{"action": []}',
            '{"action": "format"}',
        ),
        *(
            '{"action": "output_level", "value": NaN}',
            '{"action": "output_level", "value": 1.01}',
        ),
        *(
            '{"action": "output_level", "value": true}',
            '{"action": "threshold_dbfs", "value": 3}',
        ),
        *(
            '{"action": ' + "[" * 1000,
            "[" * 2000,
            '{"action": "ceiling", "value": ' + "9" * 400 + "}",
        ),
        *(
            '{"action": "profile", "text": "nonesuch"}',
            '{"action": "profile", "text": []}',
        ),
    ],
)
def test_anything_else_is_refused_with_a_reason(text: str) -> None:
    assert isinstance(parse_request(text, STATE), str)


def test_a_page_never_raises_the_ceiling_not_even_to_the_local_one() -> None:
    assert "raise it at the machine" in str(
        parse_request('{"action": "ceiling", "value": 0.45}', STATE)
    )


def test_a_page_elsewhere_asks_for_the_lower_of_two_levels() -> None:
    text = json.dumps({"action": "output_level", "value": 0.3})
    assert parse_request(text, STATE, local=False) == Request("lower_output_level", 0.3)


@pytest.mark.parametrize("seen", [6, None, "7", True])
def test_an_arming_releases_no_stop_that_its_page_had_not_seen(seen: object) -> None:
    """However late it comes: it was pressed before."""
    text = json.dumps({"action": "arm", "silenced": seen})
    assert "press again" in str(parse_request(text, STATE, silenced=7))
    text = json.dumps({"action": "arm", "silenced": 7})
    assert parse_request(text, STATE, silenced=7) == Request("arm")


BUZZING = {"action": "buzz"}


def test_a_page_on_the_machine_buzzes_what_is_armed_and_has_an_actuator() -> None:
    armed = FingerState(armed=True, muted_because="", can_buzz=True)

    def asked(finger: FingerState, *, local: bool = True) -> Request | object:
        state = RunState(fingers=(finger,))
        return parse_request(json.dumps(BUZZING), state, local=local)

    assert asked(armed) == Request("buzz")
    assert "press Resume" in str(asked(FingerState(can_buzz=True)))
    assert "actuator" in str(asked(FingerState(armed=True)))
    assert "own machine" in str(asked(armed, local=False))
