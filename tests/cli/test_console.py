import time

import pytest

from tactophone.cli.console import _ConsoleView
from tactophone.telemetry.layout import Fault, State
from tactophone.telemetry.writer import Telemetry


def test_the_terminal_says_why_there_is_no_link_once(capsys: pytest.CaptureFixture[str]) -> None:
    refused = Fault("link", "no operator at hand.local:48470 yet: certificate verify failed")
    with Telemetry("test-console") as telemetry:
        view = _ConsoleView("test-console")
        for state in (
            State(link=""),
            State(link="calling", faults=(refused,)),
            State(link="calling", faults=(refused,)),
        ):
            telemetry.update(state, now=time.monotonic())
            view.update()
    assert capsys.readouterr().err.splitlines() == [f"! {refused.text}", "calling"]
