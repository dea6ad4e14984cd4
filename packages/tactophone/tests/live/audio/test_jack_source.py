import itertools
from collections.abc import Callable

import pytest

from tactophone.core.errors import DeviceError
from tactophone.live.audio.dummy import DummyServer
from tactophone.live.audio.sources import jack_source

from . import contract

pytestmark = pytest.mark.realtime


@pytest.mark.parametrize(("air", "channels"), [("system:capture_2", 2), ("", 1)])
def test_sound_flows_from_one_or_two_ports(
    jack_server: DummyServer, air: str, channels: int
) -> None:
    with jack_source(server=jack_server.name, air=air) as source:
        blocks = list(itertools.islice(source, 20))
    assert {(block.size, block.channels, block.sample_rate) for block in blocks} == {
        (128, channels, 48_000)
    }
    assert source.channels == channels


@pytest.mark.parametrize("promise", contract.ALL)
def test_jack_keeps_the_contract(promise: Callable, jack_server: DummyServer) -> None:
    promise(lambda: jack_source(server=jack_server.name))


def test_a_microphone_that_is_not_there_gives_the_candidates(
    jack_server: DummyServer,
) -> None:
    source = jack_source(server=jack_server.name, air="system:capture_9")
    with (
        pytest.raises(
            DeviceError, match="there are system:capture_1, system:capture_2"
        ),
        source,
    ):
        pass


def test_the_same_source_survives_its_server(jack_server: DummyServer) -> None:
    with jack_source(server=jack_server.name) as source:
        blocks = iter(source)
        before = next(blocks)
        jack_server.kill()
        jack_server.start()
        after = list(itertools.islice(blocks, 50))[-1]
        assert after.start > before.start
        assert source.device.fault == ""
