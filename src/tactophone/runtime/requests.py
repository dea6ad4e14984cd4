"""Where requests from pages and other terminals are granted or refused, and the guard's word is carried out."""

import dataclasses

from tactophone.endpoints import OperatorEndpoint
from tactophone.errors import TactophoneError
from tactophone.haptics import PROFILES, Oscillator, PassthroughRenderer, open_profile
from tactophone.runtime.output_gate import OutputGate
from tactophone.telemetry import Request

LOWEST_THRESHOLD_DBFS = -120.0
"""Of the contact gate; under it lies only what 24 bits round away."""


class RequestHandler:
    """Hands on what is asked: to the guard what concerns how much may be felt, to the walk what concerns how.

    The guard's word is carried to the renderer, which drives the finger in another thread, and to nobody else.
    """

    def __init__(
        self, guard: OutputGate, renderer: Oscillator | PassthroughRenderer, receiver: OperatorEndpoint
    ) -> None:
        self.guard = guard
        self._renderer, self._receiver = renderer, receiver
        self._enforce()

    @property
    def profiles(self) -> tuple[str, ...]:
        """Names of the profiles that may be asked for: another renderer wants another start."""
        return tuple(PROFILES) if isinstance(self._renderer, Oscillator) else (self._receiver.walk.profile.name,)

    def obey(self, requests: list[Request]) -> list[str]:
        """Grant what may be granted; return the actions refused."""
        own = [request for request in requests if request.action in ("profile", "threshold_dbfs")]
        refused = self.guard.obey(request for request in requests if request not in own)
        refused += [request.action for request in own if not self._adjust(request)]
        self._enforce()
        return refused

    def stop(self) -> None:
        """Stop vibrating at once, and stay stopped until somebody arms; may be called from a signal handler."""
        self.guard.stop()
        self._renderer.stop()

    def _adjust(self, request: Request) -> bool:
        """Change how is judged or mapped; a profile or threshold that is not to be had is refused."""
        walk = self._receiver.walk
        try:
            if request.action == "profile" and request.text in self.profiles:
                walk.profile = open_profile(request.text)
            elif request.action == "threshold_dbfs" and LOWEST_THRESHOLD_DBFS <= request.value <= 0.0:
                walk.judge.threshold_dbfs = request.value
            else:
                return False
        except TactophoneError:
            return False
        return True

    def _enforce(self) -> None:
        limits = self._renderer.limits
        if limits.ceiling != self.guard.ceiling:
            self._renderer.limits = dataclasses.replace(limits, ceiling=self.guard.ceiling)
        if self.guard.armed:
            self._renderer.release()
        else:
            self._renderer.stop()
