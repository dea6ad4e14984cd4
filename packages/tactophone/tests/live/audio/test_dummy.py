import shutil

import pytest

from tactophone.core.errors import DeviceError
from tactophone.live.audio.dummy import DummyServer
from tactophone.live.audio.jack import JackClient


@pytest.mark.realtime
@pytest.mark.parametrize(("period", "synchronous"), [(64, True), (512, False)])
def test_a_server_runs_with_the_requested_period(
    period: int, synchronous: bool
) -> None:
    with DummyServer(period, synchronous=synchronous) as server:
        client = JackClient("probe", None, inputs={}, outputs={}, server=server.name)
        client.open()
        assert (client.period, client.sample_rate) == (period, 48_000)
        client.close()


def test_without_jackd_it_says_what_to_install(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(shutil, "which", lambda _: None)
    with pytest.raises(DeviceError, match="apt install jackd2"):
        DummyServer().start()
