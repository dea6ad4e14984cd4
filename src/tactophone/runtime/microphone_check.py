"""Faults of the microphones, as both sides report them."""

from collections import deque
from collections.abc import Iterator, Sequence

from tactophone.hand import each_finger, names_of
from tactophone.perception import FALLBACK_MESSAGES, FallbackDetector, FaultDetector
from tactophone.runtime.pipeline_wiring import read_calibration
from tactophone.runtime.rehearsal import rehearse_microphone_check
from tactophone.settings import Settings
from tactophone.telemetry import Fault
from tactophone.types import LIVE_SAMPLE_RATE, Detector, PipelineStep

MOST_UNCHECKED = 1 << 14
"""Blocks that may wait to be checked: seconds of them, where the main thread is late."""


class MicrophoneCheck:
    """Checks the microphones on the robot, where no codec has changed the sound yet.

    The thread of the sound only collects blocks: to measure them takes as long as several packets, eight times a
    second. ``channels`` are those of each finger.
    """

    def __init__(self, settings: Settings, *, channels: Sequence[int]) -> None:
        fingers = zip(each_finger(settings), channels, strict=True)
        self._checks = [open_microphone_check(own, channels=count) for own, count in fingers]
        for check, count in zip(self._checks, channels, strict=True):
            rehearse_microphone_check(check, channels=count)
        self._names = names_of(settings)
        self._waiting: deque[PipelineStep] = deque(maxlen=MOST_UNCHECKED)

    def collect(self, step: PipelineStep) -> None:
        """Take a step's sound, to be checked later."""
        if self._checks[step.finger]:
            self._waiting.append(step)

    def faults(self) -> Iterator[Fault]:
        """Measure the sound since the last call, and yield what is wrong with each finger's microphones."""
        while self._waiting:
            step = self._waiting.popleft()
            if check := self._checks[step.finger]:
                check.push(step.block)
        for name, check in zip(self._names, self._checks, strict=True):
            for fault in check.faults if check else ():
                yield finger_fault(name, fault.code, str(fault))


def open_microphone_check(settings: Settings, *, channels: int) -> FaultDetector | None:
    """Open the check of a finger's microphones; none if the settings switch it off."""
    if not settings.detector.check_microphones:
        return None
    calibration = read_calibration(settings.detector.calibration, channels)
    return FaultDetector(LIVE_SAMPLE_RATE, calibration.reference if calibration else None)


def microphone_faults(detector: Detector, *, finger: str = "") -> Iterator[Fault]:
    """Yield what is wrong with a finger's microphones, and what the detector falls back to."""
    if isinstance(detector, FallbackDetector):
        for fault in detector.sensor_faults:
            yield finger_fault(finger, fault.code, f"{fault} ({FALLBACK_MESSAGES[detector.mode]})")


def finger_fault(finger: str, code: str, text: str) -> Fault:
    """Return a fault with the finger's name before code and text; without, where it is the only one.

    >>> finger_fault("index", "contact-dead", "the contact microphone is dead").code
    'index-contact-dead'
    """
    return Fault(f"{finger}-{code}", f"{finger}: {text}") if finger else Fault(code, text)
