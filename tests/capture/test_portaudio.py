import itertools

import pytest

from tactophone.capture import portaudio_source

pytestmark = [pytest.mark.realtime, pytest.mark.usefixtures("portaudio")]


def test_sound_flows_from_a_device_named_in_part() -> None:
    with portaudio_source("syst") as source:
        blocks = list(itertools.islice(source, 20))
    assert {(block.size, block.channels) for block in blocks} == {(128, 2)}
