"""Whether and how strongly anything may vibrate: the local machine decides, and no page
or network can overrule it.

Muting latches. It ends in one way only: a person arms, at the machine or through the
mailbox that only this user's processes can write. Anyone who may send requests can
lower the ceiling; nobody can raise it above the machine's own.

The ceiling is stored once, in the `Limits` that a finger's gate, pipeline and renderer
share: the gate bounds each command by it, the pipeline scales the profile to it, and
the renderer bounds every sample.
"""

import math
from collections.abc import Iterable

from tactophone.core.errors import TactophoneError
from tactophone.core.settings import Settings
from tactophone.core.types import HapticCommand, PipelineStep, Prediction, Touch
from tactophone.live.telemetry.layout import FingerState, Request
from tactophone.net.endpoints import OperatorEndpoint
from tactophone.signal.haptics.limits import Limits
from tactophone.signal.haptics.oscillator import Oscillator, Renderer
from tactophone.signal.haptics.profiles import (
    PROFILES,
    actuator_response,
    open_profile,
)
from tactophone.signal.pipeline import Hand, Pipeline

EMERGENCY_STOP = "emergency stop: find the cause, then resume"
"""Why an end is muted after an emergency stop."""

MUTED = "muted: press Resume, or run `tactophone arm`"
"""Why an end is muted that a person has muted."""

STARTED_MUTED = "started muted: press Resume, or run `tactophone arm`"
"""Why an end is muted whose settings say so."""

RESTARTED = "restarted after a fault: find the cause, then resume"
"""Why a process is muted that replaces another one."""

FLOOR_SHARE = 0.01
"""Share of each window without contact in the noise floor that is shown: smoothed over
some hundred windows."""

LOWEST_THRESHOLD_DBFS = -120.0
"""Lowest contact threshold that is accepted: below the rounding of 24-bit samples."""

BUZZ_DURATION = 0.3
"""Seconds that ``buzz`` vibrates: certainly felt, and over before anyone could look for
*Stop*."""

_ROUGHEST = Prediction(
    (0.0, 0.0, 1.0), Touch.ROUGH, 1.0, level_dbfs=0.0, start=0.0, end=0.0
)
"""The prediction whose frequency ``buzz`` has."""


def armings_first(requests: Iterable[Request]) -> list[Request]:
    """Return requests with armings before all others, so that whatever mutes in the
    same moment has the last word."""
    return sorted(requests, key=lambda request: request.action != "arm")


class OutputGate:
    """What the local machine allows.

    - ``limits``: hold the machine's own ceiling, 0 to 1 of full drive, and the one in
      force from then on.
    - ``output_level``: a volume below it, 0 to 1.
    - ``muted_because``: why it starts muted; empty to start armed.

    ``buzz_asked`` is when somebody asked to feel the actuator, in s of the monotonic
    clock; 0 for never. Muting takes it back.

    >>> gate = OutputGate(Limits(ceiling=0.5))
    >>> gate.apply([Request("ceiling", 0.9), Request("stop")])
    ['ceiling']
    >>> gate.limits.ceiling, gate.armed
    (0.5, False)
    """

    def __init__(
        self, limits: Limits, *, output_level: float = 1.0, muted_because: str = ""
    ) -> None:
        self.limits = limits
        self.local_ceiling = limits.ceiling
        self.output_level = output_level
        self.muted_because = muted_because
        self.buzz_asked = 0.0
        self.stops = 0
        self._stopped = False

    @property
    def armed(self) -> bool:
        return not self.muted_because

    def stop(self) -> None:
        """Stop at once and stay stopped until armed; also the answer to SIGUSR1."""
        self._stop()
        # This is set last: a signal may have interrupted `apply`, which looks at it
        # once it has granted everything.
        self._stopped = True

    def apply(self, requests: Iterable[Request]) -> list[str]:
        """Grant what may be granted; returns the actions refused. Call it regularly,
        also without requests.

        A stop wins over an arming that arrives with it, that waited when `stop` was
        called, or that is granted at that moment.
        """
        stopped = self._stopped
        self._stopped = False
        refused: list[str] = []
        for request in armings_first(requests):
            overruled = stopped and request.action == "arm"
            if overruled or not self._grant(request):
                refused.append(request.action)
        # A signal may have stopped while an arming was granted, which then undid the
        # stop.
        if self._stopped:
            self._stop()
        return refused

    def _stop(self) -> None:
        self.stops += self.muted_because != EMERGENCY_STOP
        self.muted_because = EMERGENCY_STOP
        self.buzz_asked = 0.0

    def _grant(self, request: Request) -> bool:
        match request.action:
            case "stop":
                self._stop()
            case "mute":
                self.muted_because = self.muted_because or MUTED
                self.buzz_asked = 0.0
            case "buzz" if self.armed:
                self.buzz_asked = request.time
            case "arm":
                self.muted_because = ""
            case "ceiling" if 0.0 <= request.value <= self.local_ceiling:
                self.limits.ceiling = request.value
            case "output_level" if 0.0 <= request.value <= 1.0:
                self.output_level = request.value
            case "lower_ceiling" if request.value >= 0.0:
                self.limits.ceiling = min(self.limits.ceiling, request.value)
            case "lower_output_level" if request.value >= 0.0:
                self.output_level = min(self.output_level, request.value)
            case _:
                return False
        return True

    def bound(self, amplitude: float) -> float:
        """Return an amplitude as it is now allowed, with the output level applied; 0
        for one that is not finite."""
        if self.muted_because or not math.isfinite(amplitude):
            return 0.0
        return min(max(amplitude, 0.0) * self.output_level, self.limits.ceiling)


class FingerOutput:
    """From a pipeline's commands to what one actuator renders, and what of it may be
    changed during a run.

    The network thread calls `submit`, `buzz`, `changed` and `controls`, the main thread
    `apply` and `state`; a signal may call `stop` at any time.

    - ``settings``: this finger's settings (`tactophone.core.hand.of_finger`).
    - ``renderer``: drives the actuator, from another thread; its limits become the
      pipeline's too.
    - ``endpoint``: has the finger's pipeline: another one once a robot with other
      microphones has connected.
    - ``name``: empty for a single finger.
    - ``muted_because``: why it starts muted; empty to start armed.
    - ``before``: what the finger was in the process that this one replaces: it gets no
      stronger by that.

    ``roughness``: roughness of the newest prediction.
    """

    def __init__(
        self,
        settings: Settings,
        renderer: Renderer,
        endpoint: OperatorEndpoint,
        *,
        index: int = 0,
        name: str = "",
        muted_because: str = "",
        before: FingerState | None = None,
    ) -> None:
        self.index = index
        self.name = name
        self.renderer = renderer
        self.gate = OutputGate(
            renderer.limits,
            output_level=settings.rendering.output_level,
            muted_because=muted_because,
        )
        self.roughness = 0.0
        self._response = actuator_response(settings)
        self._endpoint = endpoint
        self._floor_dbfs = -math.inf
        self._buzz_seen = 0.0
        """The newest `OutputGate.buzz_asked` that the network thread acted on."""
        self._buzz_until = 0.0
        """When the buzz ends, in s; 0 while there is none."""
        # `_changes` grows with each call that may have changed anything; `_changing`
        # counts the calls under way, which may have changed part of it already.
        self._changes = 0
        self._changing = 0
        self._seen: tuple[int, Hand | None] = 0, None
        self.pipeline.limits = renderer.limits
        self._enforce()
        if before:
            self.apply(
                [
                    Request("lower_ceiling", before.ceiling),
                    Request("lower_output_level", before.output_level),
                    Request("profile", text=before.profile),
                ]
            )

    @property
    def pipeline(self) -> Pipeline:
        return self._endpoint.hand.pipelines[self.index]

    @property
    def profiles(self) -> tuple[str, ...]:
        """Names of the profiles that may be requested; one that needs another renderer
        needs a restart."""
        if isinstance(self.renderer, Oscillator):
            return tuple(PROFILES)
        return (self.pipeline.profile.name,)

    @property
    def can_buzz(self) -> bool:
        """Whether `buzz` is felt: a renderer of the sound itself has no sine."""
        return isinstance(self.renderer, Oscillator)

    @property
    def buzzing(self) -> bool:
        """Whether a buzz is rendered in place of the touch."""
        return self._buzz_until > 0.0

    def buzz(self, now: float) -> None:
        """Begin, continue or end the buzz that somebody asked for.

        Call it more often than commands become stale (`COMMAND_STALE_AFTER`). A request
        that is older than a buzz is not acted on: nobody waits for it any more.
        """
        asked = self.gate.buzz_asked
        if asked != self._buzz_seen:
            self._buzz_seen = asked
            if abs(now - asked) < BUZZ_DURATION:
                self._buzz_until = now + BUZZ_DURATION
        if not self.buzzing:
            return
        amplitude = self.gate.bound(self.gate.limits.ceiling)
        # Muting ends a buzz for good: armed again, it does not go on.
        if now >= self._buzz_until or not asked:
            self._buzz_until = 0.0
            amplitude = 0.0
        frequency = self.pipeline.profile.command(_ROUGHEST).frequency
        self.renderer.submit(HapticCommand(amplitude, frequency, now))

    def submit(self, step: PipelineStep) -> PipelineStep:
        """Pass the step's newest command to the renderer, unless that buzzes; returns
        the step with its commands as bounded by the gate."""
        if not step.predictions and not step.commands:
            return step
        bound = self.gate.bound
        commands = tuple(
            HapticCommand(bound(command.amplitude), command.frequency, command.time)
            for command in step.commands
        )
        if commands and not self.buzzing:
            self.renderer.submit(commands[-1])
        if step.predictions:
            self.roughness = step.predictions[-1].roughness
        for prediction in step.predictions:
            if prediction.touch is Touch.NONE:
                self._follow_floor(prediction.level_dbfs)
        return PipelineStep(step.block, step.predictions, commands, step.finger)

    def _follow_floor(self, level_dbfs: float) -> None:
        """Average the level of windows without contact, for people to see."""
        if not math.isfinite(level_dbfs):
            return
        if math.isinf(self._floor_dbfs):
            self._floor_dbfs = level_dbfs
        else:
            self._floor_dbfs += FLOOR_SHARE * (level_dbfs - self._floor_dbfs)

    def stop(self) -> None:
        """Stop vibrating at once, and stay stopped until armed; may be called from a
        signal handler."""
        self._changing += 1
        self.gate.stop()
        self.renderer.stop()
        self._changes += 1
        self._changing -= 1

    def apply(self, requests: list[Request]) -> list[str]:
        """Grant what may be granted of the requests for this finger, or for all;
        returns the actions refused.

        The gate decides on what limits the vibration; profile and threshold go to the
        pipeline.
        """
        requests = [
            request for request in requests if request.finger in (-1, self.index)
        ]
        self._changing += bool(requests)
        own = [
            request
            for request in requests
            if request.action in ("profile", "threshold_dbfs")
        ]
        if not self.can_buzz:  # then nobody grants it
            own += [request for request in requests if request.action == "buzz"]
        refused = self.gate.apply(request for request in requests if request not in own)
        refused += [request.action for request in own if not self._adjust(request)]
        self._enforce()
        # Counted last, and also where all was refused: whoever sees the count sees the
        # change too.
        self._changes += bool(requests)
        self._changing -= bool(requests)
        return refused

    def _adjust(self, request: Request) -> bool:
        """Change the pipeline's profile or threshold; false for one that does not exist
        or is out of range."""
        try:
            if request.action == "profile" and request.text in self.profiles:
                # The same profile, opened anew, would forget the touch.
                if request.text != self.pipeline.profile.name:
                    self.pipeline.profile = open_profile(request.text, self._response)
            elif (
                request.action == "threshold_dbfs"
                and LOWEST_THRESHOLD_DBFS <= request.value <= 0.0
            ):
                self.pipeline.detector.threshold.dbfs = request.value
            else:
                return False
        except TactophoneError:
            return False
        return True

    def _enforce(self) -> None:
        if self.gate.armed:
            self.renderer.release()
        # Asked again, not `else`: a signal may have stopped between the two, and the
        # release would have undone it.
        if not self.gate.armed:
            self.renderer.stop()

    def changed(self) -> bool:
        """Return whether `controls` may differ from the last call's; true at the first
        call, and while they change."""
        # This is asked twice a packet, and comparing the controls themselves takes five
        # times as long. With another robot comes another pipeline, in another hand.
        # `_changing` is read first: a change that ends in between is then seen in
        # `_changes`.
        changing = self._changing
        changes = self._changes
        hand = self._endpoint.hand
        if not changing and changes == self._seen[0] and hand is self._seen[1]:
            return False
        self._seen = changes, hand
        return True

    def controls(self) -> tuple[bool, float, float, str, float | None]:
        """Return what may be changed from outside the network thread, in the order of
        `Controls` in the log."""
        gate = self.gate
        pipeline = self.pipeline
        threshold = pipeline.detector.threshold
        return (
            gate.armed,
            gate.limits.ceiling,
            gate.output_level,
            pipeline.profile.name,
            None if threshold.follows_floor else threshold.dbfs,
        )

    def state(self) -> FingerState:
        pipeline = self.pipeline
        gate = self.gate
        return FingerState(
            name=self.name,
            armed=gate.armed,
            muted_because=gate.muted_because,
            ceiling=gate.limits.ceiling,
            local_ceiling=gate.local_ceiling,
            output_level=gate.output_level,
            profile=pipeline.profile.name,
            detector=pipeline.detector.name,
            threshold_dbfs=pipeline.detector.threshold.dbfs,
            noise_floor_dbfs=round(self._floor_dbfs, 0),
            can_buzz=self.can_buzz,
            buzzing=self.buzzing,
        )
