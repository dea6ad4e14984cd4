"""One finger of the operator's side: its gate, its renderer, and what of it may be changed during a run."""

import math

from tactophone.endpoints import OperatorEndpoint
from tactophone.haptics import Renderer
from tactophone.pipeline import Hand, Pipeline
from tactophone.runtime.device_wiring import actuator_response
from tactophone.runtime.output_gate import OutputGate
from tactophone.runtime.requests import RequestHandler
from tactophone.settings import Settings
from tactophone.telemetry import FingerState
from tactophone.types import HapticCommand, PipelineStep, Prediction, Touch


class FingerOutput:
    """From a pipeline's commands to what one actuator renders.

    ``settings`` are of this finger (`tactophone.hand.of_finger`); ``name`` is empty for a single finger.
    ``renderer`` drives the actuator, from another thread. ``muted_because`` is why it starts muted; empty to start
    armed.

    Attributes
    ----------
    roughness
        Of the newest prediction.
    """

    def __init__(
        self,
        settings: Settings,
        renderer: Renderer,
        endpoint: OperatorEndpoint,
        *,
        index: int,
        name: str,
        muted_because: str,
    ) -> None:
        rendering = settings.rendering
        self.gate = OutputGate(
            ceiling=rendering.ceiling, output_level=rendering.output_level, muted_because=muted_because
        )
        self.index, self.name, self.renderer = index, name, renderer
        self._endpoint = endpoint
        self.requests = RequestHandler(self.gate, renderer, endpoint, actuator_response(settings), finger=index)
        self.roughness = 0.0
        self.floor_dbfs = -math.inf
        self._seen: tuple[int, Hand | None] = 0, None

    @property
    def pipeline(self) -> Pipeline:
        """The pipeline in use; another one once a robot with other microphones has connected."""
        return self._endpoint.hand.pipelines[self.index]

    def submit(self, step: PipelineStep) -> PipelineStep:
        """Pass the step's newest command to the renderer; returns the step with its commands as bounded by the gate."""
        if not step.predictions and not step.commands:
            return step
        bound = self.gate.bound
        commands = tuple(
            HapticCommand(bound(command.amplitude), command.frequency, command.time) for command in step.commands
        )
        if commands:
            self.renderer.submit(commands[-1])
        if step.predictions:
            self.roughness = step.predictions[-1].roughness
        for prediction in step.predictions:
            self.floor_dbfs = _noise_floor(self.floor_dbfs, prediction)
        return PipelineStep(step.block, step.predictions, commands, step.finger)

    def changed(self) -> bool:
        """Whether `controls` may differ from those at the last call; true at the first, and while they change."""
        # Asked twice a packet: comparing the controls themselves takes five times as long. With another robot comes
        # another pipeline, in another hand.
        # `changing` is read first: a change that ends in between is then seen in `changes`.
        changing, changes, hand = self.requests.changing, self.requests.changes, self._endpoint.hand
        if not changing and changes == self._seen[0] and hand is self._seen[1]:
            return False
        self._seen = changes, hand
        return True

    def controls(self) -> tuple[bool, float, float, float, str, float | None]:
        """Return what may be changed from outside the network thread, in the order of `Controls` in the log."""
        gate, pipeline = self.gate, self.pipeline
        return (
            gate.armed, gate.ceiling, gate.output_level, pipeline.limits.ceiling, pipeline.profile.name,
            None if pipeline.detector.threshold.follows_floor else pipeline.detector.threshold.dbfs,
        )  # fmt: skip

    def state(self) -> FingerState:
        """Return what watchers are shown of this finger."""
        pipeline, gate = self.pipeline, self.gate
        return FingerState(
            name=self.name,
            armed=gate.armed,
            muted_because=gate.muted_because,
            ceiling=gate.ceiling,
            local_ceiling=gate.local_ceiling,
            output_level=gate.output_level,
            profile=pipeline.profile.name,
            detector=pipeline.detector.name,
            threshold_dbfs=pipeline.detector.threshold.dbfs,
            noise_floor_dbfs=round(self.floor_dbfs, 0),
        )


def _noise_floor(floor_dbfs: float, prediction: Prediction) -> float:
    """Smooth the level over some hundred windows without contact."""
    if prediction.touch is not Touch.NONE or not math.isfinite(prediction.level_dbfs):
        return floor_dbfs
    return prediction.level_dbfs if math.isinf(floor_dbfs) else floor_dbfs + 0.01 * (prediction.level_dbfs - floor_dbfs)
