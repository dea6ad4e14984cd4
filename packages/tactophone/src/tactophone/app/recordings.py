"""One way to open a recording, so that `feel`, `classify`, `evaluate` and `demo` decide
alike.

A recording is read before it is processed: what is wrong with its sound is corrected
(`tactophone.app.prepare`), and contact begins at its own noise floor, which is followed
from there as in a live run.
"""

import math
import os
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, BinaryIO

import numpy as np

from tactophone.app.notebook import can_draw, cell
from tactophone.app.prepare import Preparation, PreparedSource
from tactophone.app.sources import recorded
from tactophone.core.errors import ConfigError
from tactophone.core.foreign_settings import refuse_settings_here
from tactophone.core.hand import each_finger
from tactophone.core.microphones import CONTACT
from tactophone.core.recordings.read import find_recording
from tactophone.core.settings import FingerSettings, Settings
from tactophone.core.tips import DEFAULT_TIP
from tactophone.core.types import (
    AudioBlock,
    ChangedSource,
    ContactRule,
    PipelineStep,
    Source,
)
from tactophone.live.audio.arrays import (
    ArraySource,
    SupportsArray,
    is_open_file,
    source_of_array,
    source_of_open_file,
)
from tactophone.live.audio.files import CombinedSource, FileSource
from tactophone.signal.haptics.limits import Limits
from tactophone.signal.haptics.passthrough import GateProfile, is_passthrough
from tactophone.signal.haptics.profiles import open_profile
from tactophone.signal.perception.fit import ChecksFit
from tactophone.signal.perception.model_file import Model, ModelCard
from tactophone.signal.perception.noise_floor import RecordingFloor, measure_floor
from tactophone.signal.perception.opening import DetectorOptions, options_from
from tactophone.signal.pipeline import Pipeline, make_pipeline

Sound = str | os.PathLike[str] | BinaryIO | SupportsArray
"""What can be opened: a path, a file open for reading bytes, or an array."""


LEAST_POWER = 1e-12
"""Least power that is drawn, -120 dB of full scale: digital silence has no level."""


GAIN_CHANGES = (
    "the noise is turned up and down, as automatic gain does, and may be felt as "
    "touch; switch it off and record again (docs/guide/record.md)"
)


@dataclass(frozen=True, slots=True, eq=False, repr=False)
class OpenRecording:
    """A recording, corrected, and the pipeline that was opened for it; made by
    `open_recording`.

    Attributes
    ----------
    path
        The file; ``None`` for an array or an open file.
    sound
        Its corrected sound, a `Source`.
    pipeline
        With the contact threshold of this recording.
    size
        Samples in the recording.
    channels
        Of the recording; ``sound`` may have fewer.
    floor
        What the recording shows of its noise; ``None`` where a threshold was given, or
        the detector is no model.
    card
        Of the model; ``None`` for a detector of another package.
    """

    path: Path | None
    sound: Source
    pipeline: Pipeline
    size: int
    channels: int
    floor: RecordingFloor | None
    card: ModelCard | None
    _notes: list[str]
    _known: dict[str, str]
    _misfits: dict[str, str] = field(default_factory=dict)

    def __repr__(self) -> str:
        name = self.path.name if self.path else "sound without a path"
        model = self.card.name if self.card else "a detector of its own"
        return (
            f"<OpenRecording: {name}, {self.duration:.1f} s, "
            f"{self.channels} channels at {self.sound.sample_rate} Hz, {model}>"
        )

    def _repr_html_(self) -> str:
        """What a notebook shows: the line above, and the level of the contact
        microphone over time if it can be drawn."""
        return cell(repr(self), self._level_plot() if can_draw() else None)

    def _level_plot(self) -> Any:
        refuse_settings_here("matplotlib")
        from matplotlib.figure import Figure

        times: list[float] = []
        levels: list[float] = []
        with self.sound as sound:
            for block in sound:
                contact = block.samples[:, CONTACT].astype(float)
                power = max(float(np.mean(contact**2)), LEAST_POWER)
                times.append(block.end / block.sample_rate)
                levels.append(10 * math.log10(power))
        figure = Figure(figsize=(9, 2.5), layout="constrained")
        axes = figure.subplots()
        axes.plot(times, levels, linewidth=1)
        axes.set_ylabel("level, dBFS")
        axes.set_xlabel("time, s")
        return figure

    @property
    def duration(self) -> float:
        """Length, in s."""
        return self.size / self.sound.sample_rate

    @property
    def notes(self) -> list[str]:
        """Sentences on what was corrected and, after it was processed, on what does not
        fit the model."""
        return [*self._notes, *(self._misfits | self._known).values()]

    def steps(self) -> Iterator[PipelineStep]:
        """Process the recording from its beginning; the last step completes its end."""
        self.pipeline.reset()
        last: AudioBlock | None = None
        with self.sound as sound:
            for last in sound:
                yield self.pipeline.push(last)
                self.check_fit()
        if last:
            yield self.pipeline.flush(last)

    def check_fit(self) -> None:
        """Note what about the newest sound does not fit the model, for whoever pushes
        blocks without `steps`."""
        detector = self.pipeline.detector
        if isinstance(detector, ChecksFit) and (misfit := detector.misfit):
            self._misfits[misfit.code] = misfit.text


def open_recording(
    sound: Sound,
    model: str | Model = "",
    *,
    sample_rate: float | None = None,
    profile: str = "graded",
    limits: Limits | None = None,
    contact: ContactRule = "bands",
    events: bool = False,
    tip: str = DEFAULT_TIP,
    threshold_dbfs: float | None = None,
    margin_db: float | None = None,
    check_microphones: bool = True,
    block_size: int = 4096,
    channels: Sequence[int] = (),
) -> OpenRecording:
    """Open a recording and a pipeline for it, as ``tactophone feel`` does.

    Parameters
    ----------
    sound
        The path of a WAV or FLAC file; such a file, open for reading bytes; or an array
        of shape ``(samples, channels)``, with ``sample_rate``. All are decided alike.
        Channel 0 is the contact microphone and channel 1 (if there is one) the air
        microphone, unless the manifest of a data set around a path says otherwise.

        An array is NumPy's, or anything that NumPy makes one of, such as a tensor:
        floats in [-1, 1], or integers of 16 or 32 bits.
    model
        As for `open_pipeline`.
    sample_rate
        Of an array, in Hz.
    profile
        Name of a rendering profile.
    limits
        Bounds of the commands; by default a ceiling of half of full drive.
    contact
        What decides on contact: ``bands``, ``level`` or ``window``, as for
        `open_pipeline`.
    events
        Detect touch events (taps, strokes, slips); the profile ``events`` always does.
    tip
        Tip that touches, one of `tactophone.core.tips.TIP_NAMES`.
    threshold_dbfs
        Level from which there is contact, in dB of full scale; by default just over the
        recording's noise floor.
    margin_db
        How far over its noise a band is heard; by default 5 dB.
    check_microphones
        As for `open_pipeline`.
    block_size
        Samples in each block of the sound.
    channels
        Which of the file's channels are contact and air, counted from 0; a file of more
        than two needs them.

    Raises
    ------
    DatasetError
        If the file is missing or damaged, or an array is no sound.
    ModelError
        If there is no such model, or it does not fit the sound.
    ConfigError
        If there is no such profile, or ``sample_rate`` is missing.

    Examples
    --------
    ::

        recording = open_recording("finger.wav")
        for step in recording.steps():
            for prediction in step.predictions:
                print(prediction.end, prediction.touch.name)
        print(recording.notes)

        samples, rate = soundfile.read("finger.wav")
        recording = open_recording(samples, sample_rate=rate)
    """
    file = _source_of(sound, sample_rate, block_size=block_size, channels=channels)
    options = DetectorOptions(
        sample_rate=file.sample_rate,
        channels=file.channels,
        model=model,
        tip=tip,
        contact=contact,
        threshold_dbfs=threshold_dbfs,
        margin_db=margin_db,
        check_microphones=check_microphones,
        events=events or profile == "events",
    )
    return _open(file, options, profile=profile, limits=limits, chosen=bool(channels))


def open_recording_for(
    path: str | Path,
    settings: Settings,
    *,
    block_size: int = 4096,
    channels: Sequence[int] = (),
) -> OpenRecording:
    """Open a recording as the settings of a finger say; else as `open_recording`."""
    picked = _picked(path, channels)
    file = FileSource(path, block_size=block_size, channels=picked)
    options = options_from(
        settings, channels=file.channels, sample_rate=file.sample_rate
    )
    return _open(
        file,
        options,
        profile=settings.rendering.profile,
        limits=Limits(ceiling=settings.rendering.ceiling),
        chosen=bool(channels),
    )


def _source_of(
    sound: Sound,
    sample_rate: float | None,
    *,
    block_size: int,
    channels: Sequence[int],
) -> FileSource | ArraySource:
    """Return what a caller gave as a source."""
    if isinstance(sound, SupportsArray):
        return source_of_array(
            sound, sample_rate, block_size=block_size, channels=channels
        )
    if not isinstance(sound, str | os.PathLike) and not is_open_file(sound):
        raise ConfigError(
            f"a {type(sound).__name__} is no sound: give a path, a file open for "
            "reading bytes, or an array with sample_rate="
        )
    if sample_rate is not None:
        raise ConfigError(
            f"sample_rate={sample_rate:g}: a file says its rate itself; leave it out"
        )
    if isinstance(sound, str | os.PathLike):
        path = Path(sound)
        picked = _picked(path, channels)
        return FileSource(path, block_size=block_size, channels=picked)
    return source_of_open_file(sound, block_size=block_size, channels=channels)


def _picked(path: str | Path, channels: Sequence[int]) -> Sequence[int]:
    """Return the places of contact and air: as asked for, or as a manifest says of a
    file that has others beside them; else empty."""
    known = None if channels else find_recording(path)
    return known.picked if known else channels


def _open(
    file: FileSource | ArraySource,
    options: DetectorOptions,
    *,
    profile: str,
    limits: Limits | None,
    chosen: bool,
) -> OpenRecording:
    """Correct a file's sound, measure its noise, and open the pipeline for both.

    ``chosen``: the user said which channels to take, whatever a manifest says.
    """
    card = options.card
    known = find_recording(file.path) if file.path else None
    source = (
        _Exchanged(file)
        if known and known.channels == ("air", "contact") and not chosen
        else file
    )
    preparation = Preparation.of(source).for_tip(card.tip if card else "")
    if card is None or card.imported:  # trained on sound as its authors recorded it
        preparation = replace(
            preparation, offset=(0.0,) * len(preparation.offset), hum=None
        )
    floor = None
    if card and options.threshold_dbfs is None:
        floor = _measured(source, preparation, card)
        # Sound that is rendered itself keeps its level.
        if not card.imported and not is_passthrough(profile):
            louder = preparation.amplified(floor.loudest_dbfs)
            if louder != preparation:
                preparation, floor = louder, _measured(source, louder, card)
    options = replace(options, channels=len(preparation.channels), recording=floor)
    rendering = (
        GateProfile(profile) if is_passthrough(profile) else open_profile(profile)
    )
    pipeline = make_pipeline(options, rendering, limits)
    notes = preparation.notes(
        file.channels, used=card.channels if card else file.channels
    )
    notes = [*file.notes, *notes]
    if floor and floor.gain_changes:
        notes.append(GAIN_CHANGES)
    known_misfits = {}
    if card and file.sample_rate < card.sample_rate:
        known_misfits["narrow-band"] = (
            f"recorded at {file.sample_rate} Hz, so without sound over "
            f"{file.sample_rate // 2} Hz, but the model uses "
            f"up to {card.sample_rate // 2}: rough may be rendered smooth; record at "
            "a higher rate"
        )
    return OpenRecording(
        file.path,
        PreparedSource(source, preparation),
        pipeline,
        file.size,
        file.channels,
        floor,
        card,
        notes,
        known_misfits,
    )


def _measured(
    source: Source, preparation: Preparation, card: ModelCard
) -> RecordingFloor:
    with PreparedSource(source, preparation) as sound:
        heard = (block.select(card.channels_heard(block.channels)) for block in sound)
        return measure_floor(heard, sample_rate=sound.sample_rate, rule=card.gate.rule)


class _Exchanged(ChangedSource):
    """A file that holds the air microphone first."""

    def __iter__(self) -> Iterator[AudioBlock]:
        for block in self._source:
            yield block.select(slice(None, None, -1))


def corrected_source(settings: Settings) -> Source:
    """Open the recordings of all fingers as one live source, corrected as
    `open_recording` does."""
    fingers = each_finger(settings)
    opened = [
        open_recording_for(
            own.capture.device, own, block_size=settings.capture.block_size
        )
        for own in fingers
    ]
    sources = [
        recorded(each.sound, Path(own.capture.device), each.duration)
        for own, each in zip(fingers, opened, strict=True)
    ]
    return CombinedSource(sources) if settings.is_hand else sources[0]


def with_own_thresholds(settings: Settings) -> Settings:
    """Return settings with the contact threshold of each finger's recording, where none
    is given."""

    found = [
        open_recording_for(own.capture.device, own).pipeline.detector.threshold.dbfs
        for own in each_finger(settings)
    ]
    if not settings.is_hand:
        return replace(
            settings, detector=replace(settings.detector, threshold_dbfs=found[0])
        )
    fingers = zip(settings.fingers, found, strict=True)
    name = "detector.threshold_dbfs"
    return replace(
        settings,
        fingers=tuple(
            FingerSettings(each.name, (*each.settings, (name, own)))
            for each, own in fingers
        ),
    )
