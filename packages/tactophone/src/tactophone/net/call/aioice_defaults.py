"""Two defaults of aioice that do not suit a call, and for which it has no setting.

This is the only place that changes anything of aioice, and it changes public names
alone. `tests.net.call.test_libraries` fails when aioice's defaults or names change.
"""

import contextlib
from collections.abc import Iterator
from typing import Any

from aioice import stun, turn

CHANNEL_REFRESH = 240
"""Seconds until a relay's channel is bound again. Its permission ends after 300 (RFC
8656 section 9), and aioice would bind it again after 500: for 200 s of each call over a
relay nothing would pass."""

RETRANSMISSION = 0.1
"""Seconds until an unanswered check is repeated, then twice as many. aioice waits for
half a second, and the first check of one end is nearly always lost at the other end's
router."""

create_endpoint = turn.create_turn_endpoint
"""aioice's own function, whose parameter says when channels are bound again."""


async def _create_endpoint(*arguments: Any, **options: Any) -> Any:
    options["channel_refresh_time"] = CHANNEL_REFRESH
    return await create_endpoint(*arguments, **options)


def refresh_channels_in_time() -> None:
    """Let every connection from now on bind its relay's channels again before their
    permission ends."""
    turn.create_turn_endpoint = _create_endpoint


@contextlib.contextmanager
def quick_checks() -> Iterator[None]:
    """Repeat lost checks soon, while a path is searched for.

    Once there is a path, an answer to the question for consent may take as long as
    aioice gives it.
    """
    usual = stun.RETRY_RTO
    stun.RETRY_RTO = min(usual, RETRANSMISSION)
    try:
        yield
    finally:
        stun.RETRY_RTO = usual
