"""The operator's half of the walk, from sound to command, which needs no line: what `feel` runs, and so does the rest.

::

    sound ─▶ TouchDetector: detector, contact gate ─▶ belief ─▶ profile ─▶ limits ─▶ command

It is a module of its own so that feeling a file needs nothing of what sealing a line does.
"""

from collections import Counter
from dataclasses import replace

from tactophone.haptics import Limits, open_profile
from tactophone.perception import AnyTouchDetector, default_model, open_detector
from tactophone.types import AudioBlock, HapticCommand, PipelineStep, Prediction, Profile


class Pipeline:
    """Sound to what is felt: an `AudioBlock` in, a `PipelineStep` out.

    Parameters
    ----------
    judge
        Makes beliefs of the sound.
    profile, limits
        Make a command of a belief; others may be assigned at any time.

    Examples
    --------
    ::

        walk = open_pipeline(sample_rate=48_000, channels=2)
        for block in source:
            tick = walk.push(block)
            if tick.command:
                oscillator.submit(tick.command)
    """

    def __init__(self, judge: AnyTouchDetector, profile: Profile, limits: Limits | None = None) -> None:
        self.judge: AnyTouchDetector = judge
        self.profile, self.limits = profile, limits or Limits()

    @property
    def faults(self) -> Counter[str]:
        """How often there was silence for want of a belief, by cause: ``sound`` or ``model`` was garbage."""
        return self.judge.detector.faults

    def push(self, block: AudioBlock) -> PipelineStep:
        """Take sound in; give what it leads to."""
        return self._tick(block, self.judge.push(block))

    def flush(self, block: AudioBlock) -> PipelineStep:
        """Give what the end of the stream still completes; ``block`` is its last one."""
        return self._tick(replace(block, samples=block.samples[:0], start=block.end), self.judge.flush())

    def reset(self) -> None:
        """Become as new; fault counts stay."""
        self.judge.reset()

    def feel(self, prediction: Prediction) -> HapticCommand:
        """Give the command that a belief asks for, as limited; its time is when the belief came about."""
        wish = self.profile.command(prediction)
        time = prediction.end + self.judge.latency
        return self.limits.bound(HapticCommand(wish.amplitude, wish.frequency, time))

    def _tick(self, block: AudioBlock, predictions: list[Prediction]) -> PipelineStep:
        return PipelineStep(block, tuple(predictions), tuple(map(self.feel, predictions)))


def open_pipeline(
    model: str = "",
    *,
    sample_rate: int,
    channels: int,
    profile: str = "paper",
    limits: Limits | None = None,
    fast_contact: bool = True,
) -> Pipeline:
    """Make a walk for sound of a rate and channel count.

    Parameters
    ----------
    model
        Name of a shipped model, or a model file; empty: the default for so many channels.
    profile
        Name of a rendering profile.
    fast_contact
        Whether contact is told within milliseconds (`perception.contact`); if not, by the window, as in the paper.

    Raises
    ------
    ModelError, ConfigError
        If there is no such model or profile, or the model cannot judge such sound.
    """
    judge = open_detector(model or default_model(channels), sample_rate=sample_rate, fast_contact=fast_contact)
    return Pipeline(judge, open_profile(profile), limits)
