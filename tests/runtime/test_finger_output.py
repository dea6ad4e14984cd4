from tactophone.endpoints import OperatorEndpoint
from tactophone.haptics import Oscillator
from tactophone.link import Identity, Peers, ReceiveSession, Session
from tactophone.pipeline import Hand, open_pipeline
from tactophone.runtime.finger_output import FingerOutput
from tactophone.settings import Settings
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


def test_controls_count_as_changed_while_a_request_is_applied() -> None:
    # What the network thread computes meanwhile is bounded by old values or new ones, and the log must leave that open.
    class Watched(Oscillator):
        meanwhile: tuple[bool, bool] = (False, False)

        def stop(self) -> None:
            self.meanwhile = finger.changed(), finger.changed()
            super().stop()

    session = ReceiveSession(Session(Identity.create("operator"), Peers()))
    endpoint = OperatorEndpoint(session, open_pipeline(sample_rate=48_000, channels=2))
    oscillator = Watched()
    finger = FingerOutput(Settings(), oscillator, endpoint, index=0, name="", muted_because="")
    for change in (lambda: finger.requests.apply([Request("mute")]), finger.requests.stop):
        finger.changed()
        assert not finger.changed()
        change()
        assert oscillator.meanwhile == (True, True)
        assert [finger.changed(), finger.changed()] == [True, False]
