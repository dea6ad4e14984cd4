"""What packets leave for watchers, collected while they are processed and written later, many at once.

Nothing on the way from a datagram to a command needs marks, the step's telemetry or the session log. Written packet by
packet, each of these calls finds cold caches; ten in a row take the time of three (measured).
"""

from collections.abc import Callable

from tactophone.runtime.session_recorder import SessionRecorder
from tactophone.telemetry import Telemetry
from tactophone.types import PipelineStep, Touch

BATCH = 10
"""Steps after which everything is written: 25 ms of packets of 2.5 ms."""

LONGEST_DEFERRAL = 0.02
"""Seconds for which the oldest step may wait: as often as the main thread looks at telemetry."""


class DeferredTelemetry:
    """Collects marks and steps of one thread, and writes them with the session log; nobody else publishes steps."""

    def __init__(self, telemetry: Telemetry, recorder: SessionRecorder) -> None:
        self._telemetry, self._recorder = telemetry, recorder
        self._marks: list[tuple[int, tuple[tuple[int, float], ...]]] = []
        self._steps: list[tuple[PipelineStep, float, int, int]] = []
        self._since: float | None = None
        self._touches: dict[int, Touch] = {}
        self._changed = False

    def mark(self, position: int, *reached: tuple[int, float]) -> None:
        """Record that sound up to an RTP timestamp has reached each ``MARKS[index]``, and when (s)."""
        self._marks.append((position, reached))

    def publish(self, step: PipelineStep, *, now: float, truth: int = -1) -> None:
        """Take a step computed at ``now`` (s)."""
        self._steps.append((step, now, truth, self._telemetry.vibration_count(step.finger)))
        if step.predictions and step.predictions[-1].touch is not self._touches.get(step.finger, Touch.NONE):
            # The beginning and the end of a touch are shown at once: they are rare, and somebody waits for them.
            self._touches[step.finger], self._changed = step.predictions[-1].touch, True

    def due(self, now: float) -> bool:
        """Whether enough has been collected, or has waited for long enough; ask at least every few milliseconds."""
        if not self._steps and not self._recorder.waiting:
            return False
        if self._since is None:
            self._since = now
        return self._changed or len(self._steps) >= BATCH or now - self._since >= LONGEST_DEFERRAL

    def write(self, truth_of: Callable[[int], int] | None = None) -> None:
        """Write everything collected; with ``truth_of``, the `Touch` that it returns replaces that of each step."""
        self._since, self._changed = None, False
        self._recorder.write()
        marks, self._marks = self._marks, []
        self._telemetry.mark_all((index, position, now) for position, reached in marks for index, now in reached)
        steps, self._steps = self._steps, []
        truths = {finger: truth_of(finger) for finger in {step.finger for step, *_ in steps}} if truth_of else {}
        for step, computed, touch, vibrated in steps:
            truth = truths.get(step.finger, touch)
            self._telemetry.publish(step, now=computed, truth=truth, vibration_count=vibrated)
