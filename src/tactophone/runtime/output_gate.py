"""Whether the finger may feel anything, and how strongly: the truth that no page and no network can pass.

Muting latches. It ends in one way only: somebody arms, at the machine or through the mailbox that only this user's
processes reach. A ceiling can be lowered by anyone who may ask, and raised by nobody over the machine's own setting.
"""

import math
from collections.abc import Iterable

from tactophone.telemetry import Request

EMERGENCY_STOP = "emergency stop: look what is wrong, then arm"
MUTED = "muted by hand: arm to feel again"
STARTED_MUTED = "started muted: arm to feel"
RESTARTED = "restarted after a fault: look what was wrong, then arm"


class OutputGate:
    """What the local machine allows.

    Parameters
    ----------
    ceiling
        The machine's own, 0-1 of full drive.
    output_level
        Volume under the ceiling, 0-1.
    muted_because
        Why it begins muted; empty to begin armed.

    Examples
    --------
    >>> guard = OutputGate(ceiling=0.5)
    >>> guard.obey([Request("ceiling", 0.9), Request("stop")])
    ['ceiling']
    >>> guard.ceiling, guard.armed
    (0.5, False)
    """

    def __init__(self, *, ceiling: float, output_level: float = 1.0, muted_because: str = "") -> None:
        self.local_ceiling = self.ceiling = ceiling
        self.output_level = output_level
        self.muted_because = muted_because
        self.stops = 0

    @property
    def armed(self) -> bool:
        """Whether anything may be felt."""
        return not self.muted_because

    def stop(self) -> None:
        """Stop at once and stay stopped until armed; also the answer to SIGUSR1."""
        self.stops += self.muted_because != EMERGENCY_STOP
        self.muted_because = EMERGENCY_STOP

    def obey(self, requests: Iterable[Request]) -> list[str]:
        """Grant what may be granted; return the actions refused.

        Who asks to stop and who asks to arm in the same moment gets a stop.
        """
        ordered = sorted(requests, key=lambda request: request.action != "arm")
        return [request.action for request in ordered if not self._grant(request)]

    def _grant(self, request: Request) -> bool:
        match request.action:
            case "stop":
                self.stop()
            case "mute":
                self.muted_because = self.muted_because or MUTED
            case "arm":
                self.muted_because = ""
            case "ceiling" if 0.0 <= request.value <= self.local_ceiling:
                self.ceiling = request.value
            case "output_level" if 0.0 <= request.value <= 1.0:
                self.output_level = request.value
            case _:
                return False
        return True

    def amplitude(self, wished: float) -> float:
        """Bound an amplitude as it is now allowed; what is no number becomes nothing."""
        if self.muted_because or not math.isfinite(wished):
            return 0.0
        return min(max(wished, 0.0) * self.output_level, self.ceiling)
