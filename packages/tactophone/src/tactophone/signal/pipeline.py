"""Sound to haptic command: the stages of the operator's side that need no network.

::

    sound ─▶ TouchDetector ─▶ prediction ─▶ profile ─▶ limits ─▶ command

`tactophone feel`, the live system, the simulations and the benchmarks all run this. It
stands apart from `tactophone.net.endpoints` so that processing a recording needs none
of the network's libraries.

Live, the network's thread gives each packet to `Hand.push`, and what it calls in turn
is the way of a block::

    Hand.push                a packet; it waits for the next where nothing would come
      push_together          of each finger's detector, in two phases (`detector`):
        take                   contact, and the windows that are complete
        classify_windows       the model's graph, one call for all fingers
        complete               evidence, states of the touch: predictions
      Pipeline.complete      touch events, profile and limits: a step with its commands
"""

from collections.abc import Iterator, Sequence

from msgspec.structs import replace

from tactophone.core.microphones import MICROPHONES
from tactophone.core.settings import Settings
from tactophone.core.tips import DEFAULT_TIP
from tactophone.core.types import (
    AudioBlock,
    ContactRule,
    Detector,
    HapticCommand,
    PipelineStep,
    Prediction,
    Profile,
    joined,
)
from tactophone.signal.haptics.limits import Limits, peak_amplitude
from tactophone.signal.haptics.passthrough import GateProfile, is_passthrough
from tactophone.signal.haptics.profiles import actuator_response, open_profile
from tactophone.signal.perception.calibration import Calibration
from tactophone.signal.perception.detector import (
    PhasedDetector,
    begins_anew,
    push_together,
)
from tactophone.signal.perception.events import EventDetector, EventMerger
from tactophone.signal.perception.fallback import FallbackDetector
from tactophone.signal.perception.levels import LevelMeter
from tactophone.signal.perception.model_file import Model
from tactophone.signal.perception.opening import (
    DetectorOptions,
    open_detector,
    options_from,
)


class Pipeline:
    """Sound in, haptic commands out: an `AudioBlock` leads to a `PipelineStep`.

    Parameters
    ----------
    detector
        Makes predictions from sound. It holds what a page shows and changes: name,
        faults and contact threshold.
    profile
        Maps a prediction to a vibration; another may be assigned at any time.
    limits
        Bounds of every command; others may be assigned at any time, also from another
        thread. Where the ceiling is below the profile's greatest amplitude, the whole
        profile is scaled down to it, so that the contrast between smooth and rough
        stays the same in dB.
    events
        Adds a prediction for each touch event; without it, none are detected.

    Examples
    --------
    ::

        pipeline = open_pipeline(sample_rate=48_000, channels=2)
        for block in source:
            step = pipeline.push(block)
            if step.command:
                oscillator.submit(step.command)
    """

    def __init__(
        self,
        detector: Detector,
        profile: Profile,
        limits: Limits | None = None,
        *,
        events: EventMerger | None = None,
    ) -> None:
        self.detector = detector
        self._events = events
        self.limits: Limits = limits or Limits()
        self.profile = profile

    @property
    def has_events(self) -> bool:
        """Whether touch events are detected."""
        return self._events is not None

    @property
    def profile(self) -> Profile:
        """The rendering profile."""
        return self._profile_and_peak[0]

    @profile.setter
    def profile(self, profile: Profile) -> None:
        # One assignment, so that a network thread never combines a new profile with the
        # peak of the old one.
        self._profile_and_peak = profile, peak_amplitude(profile)

    def push(self, block: AudioBlock) -> PipelineStep:
        """Process a block of one finger's sound; returns its predictions and
        commands."""
        return self.complete(block, self.detector.push(block))

    def complete(
        self, block: AudioBlock, predictions: list[Prediction]
    ) -> PipelineStep:
        """Return the step of a block from the predictions that the detector made of
        it."""
        if self._events:
            predictions = list(
                self._events.merge(block, predictions, latency=self.detector.latency)
            )
        return self._step(block, predictions)

    def flush(self, block: AudioBlock) -> PipelineStep:
        """Return what the end of the stream still completes; ``block`` is the last one
        pushed."""
        return self._step(block.part(block.size, block.size), self.detector.flush())

    def reset(self) -> None:
        """Return to the initial state; fault counts stay."""
        self.detector.reset()
        if self._events:
            self._events.reset()

    def restart(self) -> None:
        """Begin another stream of the same microphones, whose faults stay known."""
        if isinstance(self.detector, FallbackDetector):
            self.detector.restart()
        else:
            self.detector.reset()
        if self._events:
            self._events.reset()

    def command_for(self, prediction: Prediction) -> HapticCommand:
        """Return the command for a prediction, as limited; its time is when the
        prediction was made."""
        (profile, peak), limits = self._profile_and_peak, self.limits
        command = profile.command(prediction)
        amplitude = command.amplitude * limits.scale_for(peak)
        return limits.bound(
            HapticCommand(
                amplitude, command.frequency, prediction.end + self.detector.latency
            )
        )

    def _step(self, block: AudioBlock, predictions: list[Prediction]) -> PipelineStep:
        return PipelineStep(
            block, tuple(predictions), tuple(map(self.command_for, predictions))
        )


class Hand:
    """The pipelines of all fingers of a robot: the sound of all goes in, and a step of
    each comes out.

    Every finger has its own detector, profile and limits, and classifies as it would
    alone: in a batch, P(rough) may differ by 1e-5. The microphones of the fingers are
    checked in turn, a hop of 11 ms after each other. One finger is a hand too: its
    sound passes as it is.

    - ``pipelines``: one for each finger, in the order of the channels.
    - ``channels``: of each pipeline's sound: 1 leaves out the air channel, which a
      finger without that microphone has as silence. By default 2 each; the sound of a
      single finger has whatever its pipeline takes.
    - ``fingers``: number of fingers.

    >>> import numpy as np
    >>> hand = Hand([open_pipeline(sample_rate=48_000, channels=2) for _ in range(3)])
    >>> sound = AudioBlock(np.zeros((480, 6), np.float32), 48_000)
    >>> [(step.finger, step.block.channels) for step in hand.push(sound)]
    [(0, 2), (1, 2), (2, 2)]
    """

    def __init__(
        self, pipelines: Sequence[Pipeline], *, channels: Sequence[int] = ()
    ) -> None:
        self.pipelines = list(pipelines)
        self.fingers = len(self.pipelines)
        self._channels = list(channels) or [2] * self.fingers
        # Blocks that wait for the next, and the positions in the stream up to which
        # they may wait and at which the next block is expected.
        self._waiting: list[AudioBlock] = []
        self._due = 0
        self._next = 0
        detectors = [pipeline.detector for pipeline in self.pipelines]
        self._phased = [each for each in detectors if isinstance(each, PhasedDetector)]
        self._gates = [each.gate for each in self._phased if each.gate]
        # Events need each block at once, and a detector without a gate cannot say that
        # a block leads to nothing.
        self._may_wait = len(self._gates) == self.fingers and not any(
            pipeline.has_events for pipeline in self.pipelines
        )
        # The levels of several fingers, and the channel of the sound that each gate
        # hears.
        self._levels: LevelMeter | None = None
        self._contact_channels: list[int] = []
        for finger, detector in enumerate(detectors):
            if isinstance(detector, FallbackDetector):
                detector.take_turn(finger)
        if self.fingers > 1:
            self._share_levels()

    def _share_levels(self) -> None:
        """Measure the levels of all fingers in one call, where all are measured alike:
        five fingers then cost a third less."""
        alike = len({gate.levels.settings for gate in self._gates}) == 1
        if not self._may_wait or not alike:
            self._may_wait = False
            return
        self._levels = self._gates[0].levels.for_fingers(self.fingers)
        for finger, gate in enumerate(self._gates):
            gate.share(self._levels, finger)
            own = gate.channel_of(self._channels[finger])
            self._contact_channels.append(len(MICROPHONES) * finger + own)

    def push(self, block: AudioBlock) -> Iterator[PipelineStep]:
        """Process a block of sound of all fingers: their windows together, the rest
        when the iterator comes to it.

        A short block that leads to nothing waits for the next, with which it is
        processed: then there is no step.
        """
        self._waiting.append(block)
        if self._leads_to_nothing(block):
            self._next = block.end
            return
        waiting = self._waiting
        self._waiting = []
        for whole in joined(waiting):
            yield from self._process(whole)

    def _leads_to_nothing(self, block: AudioBlock) -> bool:
        """Whether a block completes no window and changes no finger's contact, so that
        it can wait."""
        completes_nothing = block.end < self._due and block.start == self._next
        if not completes_nothing or block.concealed:
            return False
        if self._levels:
            self._levels.look_ahead(block.samples.T[self._contact_channels])
        else:
            gate = self._gates[0]
            gate.levels.look_ahead(gate.own_channel(block))
        return all(gate.stays_ahead for gate in self._gates)

    def _process(self, block: AudioBlock) -> Iterator[PipelineStep]:
        """Process a block, and the sound that waited for it."""
        parts = [block] if self.fingers == 1 else split_fingers(block, self._channels)
        if self._levels:
            self._measure_levels(self._levels, block)
        predictions = push_together(
            [pipeline.detector for pipeline in self.pipelines], parts
        )
        for finger, pipeline in enumerate(self.pipelines):
            step = pipeline.complete(parts[finger], predictions[finger])
            yield replace(step, finger=finger) if finger else step
        self._next = block.end
        if self._may_wait:
            self._due = min(detector.due for detector in self._phased)

    def _measure_levels(self, levels: LevelMeter, block: AudioBlock) -> None:
        """Measure the levels of all fingers, which their gates read."""
        lost = block.start - self._next + levels.ahead
        if begins_anew(lost, block.sample_rate):
            levels.reset()
        levels.push(block.samples.T[self._contact_channels])

    def reset(self) -> None:
        """Return to the initial state; fault counts stay."""
        self._forget_sound()
        for pipeline in self.pipelines:
            pipeline.reset()

    def restart(self) -> None:
        """Begin another stream of the same microphones, whose faults stay known."""
        self._forget_sound()
        for pipeline in self.pipelines:
            pipeline.restart()

    def _forget_sound(self) -> None:
        self._waiting = []
        self._due = 0
        if self._levels:
            self._levels.reset()


def split_fingers(block: AudioBlock, channels: Sequence[int]) -> list[AudioBlock]:
    """Return the sound of each finger, of which each has the given number of channels,
    1 or 2.

    The block has two channels for each; the sound of a single finger passes if it has
    that finger's channels already. Raises `ValueError` for any other number.
    """
    if [block.channels] == list(channels):
        return [block]
    if block.channels != 2 * len(channels):
        raise ValueError(
            f"sound of {block.channels} channels, but {len(channels)} fingers have "
            f"{2 * len(channels)}"
        )
    return [
        block.select(slice(2 * at, 2 * at + count)) for at, count in enumerate(channels)
    ]


def open_pipeline(
    model: str | Model = "",
    *,
    sample_rate: int,
    channels: int,
    profile: str = "graded",
    limits: Limits | None = None,
    contact: ContactRule = "bands",
    follow_floor: bool = True,
    events: bool = False,
    tip: str = DEFAULT_TIP,
    calibration: Calibration | None = None,
    check_microphones: bool = True,
) -> Pipeline:
    """Open a pipeline for live sound of a given rate and channel count, which decides
    as `tactophone receive` does.

    Parameters
    ----------
    model
        Name of a shipped model, path of a model file, or name of a detector that
        another package registers as an entry point ``tactophone.detectors``; empty: the
        shipped model for the tip. Or a model that was read.
    sample_rate
        Of the sound to come, in Hz; 2000 or more.
    channels
        1 (contact) or 2 (contact, air).
    profile
        Name of a rendering profile.
    limits
        Bounds of the commands; by default a ceiling of half of full drive.
    contact
        What decides on contact: ``bands`` or ``level``, within milliseconds
        (`signal.perception.contact`), or ``window``, as in the paper.
    follow_floor
        Let the contact threshold follow the noise floor, until another is assigned
        (`ContactThreshold`); if false, it is the model's own.
    events
        Detect touch events (taps, strokes, slips); the profile ``events`` always does.
    tip
        Tip that touches, one of `tactophone.core.tips.TIP_NAMES`.
    calibration
        Levels of the set-up, where they were measured.
    check_microphones
        Look for faults of the microphones, and fall back to what still works. Switch it
        off for test signals, whose channels no two microphones would deliver.

    Raises
    ------
    ModelError
        If there is no such model, or it does not fit the sound.
    ConfigError
        If there is no such profile.
    """
    options = DetectorOptions(
        sample_rate=sample_rate,
        channels=channels,
        model=model,
        tip=tip,
        contact=contact,
        follow_floor=follow_floor,
        calibration=calibration,
        check_microphones=check_microphones,
        events=events or profile == "events",
    )
    return make_pipeline(options, open_profile(profile), limits)


def open_pipeline_for(settings: Settings, *, channels: int) -> Pipeline:
    """Open the live pipeline for so many channels, with the model and profile that the
    settings name."""
    name = settings.rendering.profile
    profile: Profile
    if is_passthrough(name):
        profile = GateProfile(name)
    else:
        profile = open_profile(name, actuator_response(settings))
    options = options_from(settings, channels=channels)
    return make_pipeline(options, profile, Limits(ceiling=settings.rendering.ceiling))


def make_pipeline(
    options: DetectorOptions, profile: Profile, limits: Limits | None = None
) -> Pipeline:
    """Make the pipeline whose detector the options describe; every door calls this.

    Raises `ModelError` as `open_detector` does.
    """
    detector = open_detector(options)
    merger = None
    if options.events:
        merger = open_events(
            sample_rate=options.sample_rate, channels=options.channels, tip=options.tip
        )
    return Pipeline(detector, profile, limits, events=merger)


def open_events(
    *, sample_rate: int, channels: int, tip: str = DEFAULT_TIP
) -> EventMerger:
    """Make the detector of touch events for a pipeline."""
    return EventMerger(
        EventDetector(sample_rate=sample_rate, channels=min(channels, 2), tip=tip)
    )
