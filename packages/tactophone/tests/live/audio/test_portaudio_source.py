import itertools
from collections.abc import Callable

import pytest

from tactophone.live.audio.sources import portaudio_source

from . import contract

pytestmark = [pytest.mark.realtime, pytest.mark.usefixtures("portaudio")]


def test_sound_flows_from_a_device_named_in_part() -> None:
    with portaudio_source("syst") as source:
        blocks = list(itertools.islice(source, 20))
    assert {(block.size, block.channels) for block in blocks} == {(128, 2)}


@pytest.mark.parametrize("promise", contract.ALL)
def test_portaudio_keeps_the_contract(promise: Callable) -> None:
    promise(lambda: portaudio_source("syst"))
