"""Grants or refuses the requests of pages and other terminals, and applies what was granted."""

import dataclasses

from tactophone.endpoints import OperatorEndpoint
from tactophone.errors import TactophoneError
from tactophone.haptics import PROFILES, UNKNOWN, ActuatorResponse, Oscillator, Renderer, open_profile
from tactophone.pipeline import Pipeline
from tactophone.runtime.output_gate import OutputGate
from tactophone.telemetry import Request

LOWEST_THRESHOLD_DBFS = -120.0
"""Of the contact gate: below the rounding of 24-bit samples."""


class RequestHandler:
    """Passes requests on: to the gate what limits the vibration, to the pipeline what concerns detection and profile.

    The gate's decisions are then applied to the renderer, which drives the actuator in another thread, and to the
    pipeline, which scales the profile to the ceiling.

    Attributes
    ----------
    changes
        Grows with each call that may have changed anything.
    changing
        Number of calls under way, which may have changed part of it already.
    """

    def __init__(
        self,
        gate: OutputGate,
        renderer: Renderer,
        endpoint: OperatorEndpoint,
        response: ActuatorResponse = UNKNOWN,
        *,
        finger: int = 0,
    ) -> None:
        self.gate = gate
        self._response = response
        self._renderer, self._endpoint, self._finger = renderer, endpoint, finger
        self.changes = self.changing = 0
        self._enforce()

    @property
    def profiles(self) -> tuple[str, ...]:
        """Names of the profiles that may be requested; one that needs another renderer needs a restart."""
        return tuple(PROFILES) if isinstance(self._renderer, Oscillator) else (self._pipeline.profile.name,)

    @property
    def _pipeline(self) -> Pipeline:
        return self._endpoint.hand.pipelines[self._finger]

    def apply(self, requests: list[Request]) -> list[str]:
        """Grant what may be granted of the requests for this finger, or for all; returns the actions refused."""
        requests = [request for request in requests if request.finger in (-1, self._finger)]
        self.changing += bool(requests)
        own = [request for request in requests if request.action in ("profile", "threshold_dbfs")]
        refused = self.gate.apply(request for request in requests if request not in own)
        refused += [request.action for request in own if not self._adjust(request)]
        self._enforce()
        # Counted last, and whatever was refused: who sees the count sees the change.
        self.changes += bool(requests)
        self.changing -= bool(requests)
        return refused

    def stop(self) -> None:
        """Stop vibrating at once, and stay stopped until armed; may be called from a signal handler."""
        self.changing += 1
        self.gate.stop()
        self._renderer.stop()
        self.changes += 1
        self.changing -= 1

    def _adjust(self, request: Request) -> bool:
        """Change the pipeline's profile or threshold; false for one that does not exist or is out of range."""
        pipeline = self._pipeline
        try:
            if request.action == "profile" and request.text in self.profiles:
                pipeline.profile = open_profile(request.text, self._response)
            elif request.action == "threshold_dbfs" and LOWEST_THRESHOLD_DBFS <= request.value <= 0.0:
                pipeline.detector.threshold.dbfs = request.value
            else:
                return False
        except TactophoneError:
            return False
        return True

    def _enforce(self) -> None:
        # The renderer comes first: it bounds every sample, so a lowered ceiling holds before the profile is scaled.
        limited: Renderer | Pipeline
        for limited in (self._renderer, self._pipeline):
            if limited.limits.ceiling != self.gate.ceiling:
                limited.limits = dataclasses.replace(limited.limits, ceiling=self.gate.ceiling)
        if self.gate.armed:
            self._renderer.release()
        if not self.gate.armed:  # asked again: a signal may have stopped meanwhile
            self._renderer.stop()
