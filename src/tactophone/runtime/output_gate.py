"""Whether and how strongly anything may vibrate: the local machine decides, and no page or network can overrule it.

Muting latches. It ends in one way only: a person arms, at the machine or through the mailbox that only this user's
processes can write. Anyone who may send requests can lower the ceiling; nobody can raise it above the machine's own.
"""

import math
from collections.abc import Iterable

from tactophone.telemetry import Request

EMERGENCY_STOP = "emergency stop: find the cause, then arm"
MUTED = "muted by request: arm to vibrate again"
STARTED_MUTED = "started muted: arm to vibrate"
RESTARTED = "restarted after a fault: find the cause, then arm"


class OutputGate:
    """What the local machine allows.

    ``ceiling`` is the machine's own, 0-1 of full drive, ``output_level`` a volume below it, 0-1. ``muted_because`` is
    why it starts muted; empty to start armed.

    Examples
    --------
    >>> gate = OutputGate(ceiling=0.5)
    >>> gate.apply([Request("ceiling", 0.9), Request("stop")])
    ['ceiling']
    >>> gate.ceiling, gate.armed
    (0.5, False)
    """

    def __init__(self, *, ceiling: float, output_level: float = 1.0, muted_because: str = "") -> None:
        self.local_ceiling = self.ceiling = ceiling
        self.output_level = output_level
        self.muted_because = muted_because
        self.stops = 0
        self._stopped = False

    @property
    def armed(self) -> bool:
        """Whether anything may vibrate."""
        return not self.muted_because

    def stop(self) -> None:
        """Stop at once and stay stopped until armed; also the answer to SIGUSR1."""
        self._stop()
        self._stopped = True

    def apply(self, requests: Iterable[Request]) -> list[str]:
        """Grant what may be granted; returns the actions refused. Call it regularly, also without requests.

        Of a stop and an arming that arrive together, the stop wins, and so it does over an arming that waited when
        `stop` was called, or is granted at that moment.
        """
        stopped, self._stopped = self._stopped, False
        ordered = sorted(requests, key=lambda request: request.action != "arm")
        refused: list[str] = [
            request.action for request in ordered if (stopped and request.action == "arm") or not self._grant(request)
        ]
        if self._stopped:
            self._stop()
        return refused

    def _stop(self) -> None:
        self.stops += self.muted_because != EMERGENCY_STOP
        self.muted_because = EMERGENCY_STOP

    def _grant(self, request: Request) -> bool:
        match request.action:
            case "stop":
                self._stop()
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

    def bound(self, amplitude: float) -> float:
        """Return an amplitude as it is now allowed, with the output level applied; 0 for one that is not finite."""
        if self.muted_because or not math.isfinite(amplitude):
            return 0.0
        return min(max(amplitude, 0.0) * self.output_level, self.ceiling)
