"""What a call changes in its libraries, and what they would have to change for that to
be wrong."""

import inspect

import pytest

pytest.importorskip("aioice")
pytest.importorskip("wormhole")

from aioice import ice, stun, turn

from tactophone.net.call import aioice_defaults


def test_aioice_still_refreshes_channels_too_late_and_repeats_checks_too_late() -> None:
    """Where this fails for a newer aioice, `aioice_defaults` can lose what it holds."""
    parameters = inspect.signature(aioice_defaults.create_endpoint).parameters
    permission = 300
    assert parameters["channel_refresh_time"].default > permission
    assert permission > aioice_defaults.CHANNEL_REFRESH
    assert stun.RETRY_RTO > aioice_defaults.RETRANSMISSION


def test_aioice_opens_relays_by_the_name_that_is_replaced(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    monkeypatch.setattr(turn, "create_turn_endpoint", aioice_defaults.create_endpoint)
    assert "turn.create_turn_endpoint(" in inspect.getsource(ice)
    aioice_defaults.refresh_channels_in_time()
    assert turn.create_turn_endpoint is not aioice_defaults.create_endpoint


def test_checks_are_quick_only_while_a_way_is_searched_for() -> None:
    usual = stun.RETRY_RTO
    with aioice_defaults.quick_checks():
        assert usual > stun.RETRY_RTO
    assert usual == stun.RETRY_RTO


def test_wormhole_has_the_names_that_bound_a_mailbox() -> None:
    from wormhole import _rendezvous

    assert issubclass(_rendezvous.WSFactory.protocol, _rendezvous.WSClient)
    source = inspect.getsource(_rendezvous.RendezvousConnector)
    for used in ("WSFactory(self", "self._B = ", "setProtocolOptions("):
        assert used in source
    assert "mailbox_connection=Connected(" in source
