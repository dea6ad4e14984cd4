"""The one way to open a detector, from the one value that says all that decides.

The operator, the loopback, `feel`, `evaluate`, Python, pages and plug-ins differ in
where their sound comes from and in what they do with a prediction. They must not differ
in what they take for a touch. So each of them fills in `DetectorOptions`, and
`open_detector` makes the detector from it.

Two things differ between a live run and a recording, because a recording can be read
before it is played: `DetectorOptions.recording`, the noise floor that was measured
ahead, and the sound itself, from which `tactophone.app.prepare` has removed hum, offset
and channels without a microphone. Everything else is the same.
"""

import math
from dataclasses import dataclass
from pathlib import Path
from typing import cast

from tactophone.core.microphones import check_channels
from tactophone.core.settings import Settings
from tactophone.core.tips import DEFAULT_TIP
from tactophone.core.types import LIVE_SAMPLE_RATE, ContactRule, Detector
from tactophone.signal.perception.calibration import Calibration
from tactophone.signal.perception.detector import TouchDetector
from tactophone.signal.perception.fallback import FallbackDetector
from tactophone.signal.perception.health import TREBLE_LOWEST_RATE, FaultDetector
from tactophone.signal.perception.model_file import Model, ModelCard, read_model
from tactophone.signal.perception.models import (
    default_model,
    is_registered,
    model_path,
    open_registered,
    open_touch_detector,
    tip_mismatch,
)
from tactophone.signal.perception.noise_floor import RecordingFloor


@dataclass(frozen=True, slots=True, kw_only=True)
class DetectorOptions:
    """All that decides what a finger's sound is taken for.

    >>> detector = open_detector(DetectorOptions(sample_rate=48_000, channels=2))
    >>> detector.name, detector.threshold.follows_floor
    ('texture', True)
    """

    sample_rate: int
    """Of the sound to come, in Hz; 2000 or more."""

    channels: int
    """Of the sound to come: 1 (contact) or 2 (contact, air)."""

    model: str | Model = ""
    """Name of a shipped model, path of a model file, name of a detector that another
    package registers, or a model that was read; empty: the shipped model for the
    tip."""

    tip: str = DEFAULT_TIP
    """Tip that touches, one of `tactophone.core.tips.TIP_NAMES`."""

    contact: ContactRule = "bands"
    """What decides on contact."""

    threshold_dbfs: float | None = None
    """Level from which there is contact; it goes before every other and follows no
    noise."""

    follow_floor: bool = True
    """Whether the contact threshold follows the noise where none is given; if not, it
    is the model's own."""

    margin_db: float | None = None
    """How far over its noise a band is heard; else the calibration's, or 5 dB."""

    calibration: Calibration | None = None
    """Levels of the set-up, where they were measured."""

    check_microphones: bool = True
    """Whether the detector looks for faults of the microphones and falls back safely.
    Sound under 8 kHz cannot be checked."""

    events: bool = False
    """Whether touch events (taps, strokes, slips) are detected beside touch."""

    recording: RecordingFloor | None = None
    """The noise floor of the recording that is to come, measured ahead; ``None`` in a
    live run."""

    @property
    def chosen_model(self) -> str | Model:
        """The model, or the shipped one for the tip where none is named."""
        return self.model or default_model(self.tip)

    @property
    def card(self) -> ModelCard | None:
        """Card of the model; ``None`` for a detector of another package.

        Raises `ModelError` if there is no such model.
        """
        model = self.chosen_model
        if isinstance(model, Model):
            return model.card
        return None if is_registered(model) else read_model(model_path(model)).card


def options_from(
    settings: Settings, *, channels: int, sample_rate: int = LIVE_SAMPLE_RATE
) -> DetectorOptions:
    """Return what the settings say about a finger's detector, for sound of so many
    channels.

    In the settings, which are text, *nan* stands for a number that nobody gave.
    """
    chosen = settings.detector
    return DetectorOptions(
        sample_rate=sample_rate,
        channels=channels,
        model=chosen.model,
        tip=settings.capture.tip,
        contact=cast(ContactRule, chosen.contact),
        threshold_dbfs=_given(chosen.threshold_dbfs),
        margin_db=_given(chosen.margin_db),
        calibration=read_calibration(chosen.calibration, channels),
        check_microphones=chosen.check_microphones,
        events=chosen.events or settings.rendering.profile == "events",
    )


def _given(value: float) -> float | None:
    return None if math.isnan(value) else value


def tip_warning(settings: Settings) -> str:
    """Return what is wrong if the model is for another tip than the settings name;
    empty otherwise."""
    tip = settings.capture.tip
    model = settings.detector.model or default_model(tip)
    if is_registered(model):
        return ""
    return tip_mismatch(read_model(model_path(model)).card, tip)


def read_calibration(path: str, channels: int) -> Calibration | None:
    """Read the calibration at ``path``; none if the path is empty or the number of
    microphones differs."""
    if not path:
        return None
    calibration = Calibration.read(Path(path).expanduser())
    return calibration if calibration.channels == channels else None


def open_detector(options: DetectorOptions) -> Detector:
    """Open the detector that the options describe.

    Raises `ModelError` if there is no such model, or it does not fit the sound.
    """
    check_channels(options.channels)
    model = options.chosen_model
    if isinstance(model, str) and is_registered(model):
        # Another package's detector decides by itself; only a given threshold reaches
        # it.
        own = open_registered(
            model, sample_rate=options.sample_rate, channels=options.channels
        )
        if options.threshold_dbfs is not None:
            own.threshold.dbfs = options.threshold_dbfs
        return own
    detector = open_touch_detector(
        model,
        sample_rate=options.sample_rate,
        contact=options.contact,
        follow_floor=options.follow_floor and options.contact != "window",
    )
    _set_contact(detector, options)
    check = open_fault_detector(options)
    if check is None:
        return detector
    return FallbackDetector(detector, check, channels=options.channels)


def open_fault_detector(options: DetectorOptions) -> FaultDetector | None:
    """Open what looks for faults of the microphones; ``None`` where that is switched
    off, or the rate is too low for it."""
    if not options.check_microphones or options.sample_rate < TREBLE_LOWEST_RATE:
        return None
    reference = options.calibration.reference if options.calibration else None
    return FaultDetector(options.sample_rate, reference)


def _set_contact(detector: TouchDetector, options: DetectorOptions) -> None:
    """Set the level from which there is contact: the first that is known of one that
    was given, the recording's and the calibration's; else the model's own, which
    follows the noise."""
    if options.threshold_dbfs is not None:
        detector.threshold.dbfs = options.threshold_dbfs
        return
    recording = options.recording
    if recording and not recording.gated:
        detector.begin(recording)
    calibration = options.calibration
    if options.contact == "bands":
        # Bands follow the noise, whatever level was calibrated. What was calibrated for
        # them is the margin.
        margin_db = options.margin_db
        if margin_db is None and calibration:
            margin_db = calibration.margin_db
        if detector.floor and margin_db is not None:
            detector.floor.margin_db = margin_db
    elif calibration and not recording:
        # A model whose loudness rule was not calibrated goes on following the noise.
        level_dbfs = calibration.threshold_for(detector.window_detector.card.gate.rule)
        if level_dbfs is not None:
            detector.threshold.dbfs = level_dbfs
