from tactophone.config import Settings
from tactophone.endpoints import OperatorEndpoint
from tactophone.haptics import Oscillator
from tactophone.link import Identity, Peers, ReceiveSession, Session
from tactophone.pipeline import Hand, open_pipeline
from tactophone.runtime.finger_output import FingerOutput
from tactophone.telemetry import Request


def test_controls_count_as_changed_after_each_request_stop_and_pipeline_and_not_between() -> None:
    session = ReceiveSession(Session(Identity.create("operator"), Peers()))
    endpoint = OperatorEndpoint(session, open_pipeline(sample_rate=48_000, channels=2))
    finger = FingerOutput(Settings(), Oscillator(), endpoint, index=0, name="", muted_because="")
    assert [finger.changed(), finger.changed()] == [True, False]
    finger.requests.apply([])
    assert not finger.changed()
    finger.requests.apply([Request("ceiling", 0.2)])
    assert [finger.changed(), finger.changed()] == [True, False]
    finger.requests.stop()
    assert [finger.changed(), finger.changed()] == [True, False]
    endpoint.hand = Hand([open_pipeline(sample_rate=48_000, channels=1)])
    assert [finger.changed(), finger.changed()] == [True, False]
