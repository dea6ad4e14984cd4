"""What a page may feel and do, decided without a server: nothing where it is muted, and
less from another machine."""

from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from aiohttp import web

from tactophone.core.types import (
    AudioBlock,
    HapticCommand,
    PipelineStep,
    Prediction,
    Touch,
)
from tactophone.faces.web.devices import command_of
from tactophone.faces.web.views import is_local
from tactophone.live.telemetry.layout import FingerState, RunState
from tactophone.live.telemetry.watcher import Watcher
from tactophone.live.telemetry.writer import Telemetry


@pytest.mark.parametrize("armed", [True, False])
def test_a_page_renders_a_command_only_while_the_finger_is_armed(armed: bool) -> None:
    with Telemetry("test-guards") as telemetry:
        telemetry.update(RunState(fingers=(FingerState(armed=armed),)), now=1e9)
        block = AudioBlock(np.full((480, 2), 0.5, np.float32), 48_000)
        prediction = Prediction((0, 0, 1), Touch.ROUGH, 1.0, -20.0, 0, 0)
        telemetry.publish(
            PipelineStep(block, (prediction,), (HapticCommand(0.25, 60.0, 0.0),)),
            now=1e9,
        )
        watcher = Watcher.find("test-guards")
        assert watcher is not None
        command = command_of(watcher.snapshot(), None)["command"]
    assert command[0] == (0.25 if armed else 0.0)


@pytest.mark.parametrize(
    ("peer", "own", "local"),
    [
        ("127.0.0.1", "127.0.0.1", True),
        ("192.0.2.7", "192.0.2.7", True),
        ("192.0.2.8", "192.0.2.7", False),
        (None, "192.0.2.7", False),
    ],
)
def test_a_page_is_local_where_both_ends_have_one_address(
    peer: str | None, own: str, local: bool
) -> None:
    ends: dict[str, Any] = {"peername": peer and (peer, 1), "sockname": (own, 2)}
    request = SimpleNamespace(transport=SimpleNamespace(get_extra_info=ends.get))
    assert is_local(cast(web.Request, request)) is local
    assert not is_local(cast(web.Request, SimpleNamespace(transport=None)))
