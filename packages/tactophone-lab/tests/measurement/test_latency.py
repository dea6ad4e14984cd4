import numpy as np
import pytest

from tactophone.core.settings import Settings, change
from tactophone.live.audio.dummy import DummyServer
from tactophone.live.telemetry.layout import STAGES
from tactophone_lab.measurement.impulses import Graph, measure


@pytest.mark.realtime
@pytest.mark.timed
def test_impulses_cross_the_running_system(jack_server: DummyServer) -> None:
    settings = change(
        Settings(), ["link.packet_duration=0.0025", "process.name=test-latency"]
    )
    measured = measure(settings, Graph(jack_server.name), impulses=12)
    assert measured.missed <= 1
    assert np.median(measured.end_to_end) < 0.012
    assert measured.disagreement < 0.001
    assert set(measured.stages) == set(STAGES)
