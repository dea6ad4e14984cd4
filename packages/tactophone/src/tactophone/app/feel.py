"""A recording as the vibration that a finger would feel, with a timeline of
predictions, events and scores."""

from collections import Counter
from collections.abc import Callable, Iterable, Iterator, Sequence
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

from tactophone.app.plot import draw_recording
from tactophone.app.recordings import open_recording_for
from tactophone.app.vibration_wav import (
    OutputFiles,
    RunScores,
    RunSummary,
    process_recording,
    score_run,
)
from tactophone.core.errors import ConfigError, TactophoneError
from tactophone.core.processes import make_room
from tactophone.core.recordings.layouts import sounds_in
from tactophone.core.recordings.read import ground_truth
from tactophone.core.recordings.values import Segment
from tactophone.core.settings import Settings
from tactophone.core.tips import DEFAULT_TIP
from tactophone.core.types import PipelineStep, TouchEvent, ignore
from tactophone.live.telemetry.timeline import read_timeline
from tactophone.signal.perception.models import tip_mismatch
from tactophone.signal.perception.noise_floor import RecordingFloor
from tactophone.signal.pipeline import Pipeline


@dataclass(frozen=True, slots=True)
class Felt:
    """A recording that was processed, with the files written.

    ``notes`` state what was corrected or is missing; ``events`` counts touch events by
    kind; ``floor`` is ``None`` where a threshold was given, and ``scores`` where no
    label says what was touched.
    """

    path: Path
    pipeline: Pipeline
    profile: str
    chosen_for_mono: bool
    """Whether the model was chosen for the only channel, which was taken as the contact
    microphone."""
    label: str
    truth: tuple[Segment, ...]
    summary: RunSummary
    files: dict[str, Path]
    floor: RecordingFloor | None
    notes: list[str]
    scores: RunScores | None
    events: Counter[str] = field(default_factory=Counter)
    tip_warning: str = ""
    """What is wrong with the model for the tip, if anything."""

    def as_json(self) -> dict[str, Any]:
        """Return what ``feel --json`` prints."""
        return {
            "recording": str(self.path),
            "model": self.pipeline.detector.name,
            "profile": self.profile,
            "label": self.label or None,
            **asdict(self.summary),
            "threshold_dbfs": self.pipeline.detector.threshold.dbfs,
            "noise_floor_dbfs": self.floor.floor_dbfs
            if self.floor and self.floor.known
            else None,
            "notes": self.notes,
            "false_bumps": self.scores and self.scores.false_bumps,
            "dips": self.scores and self.scores.dips,
            "events": dict(self.events),
            "speed": self.summary.speed,
            "files": {kind: str(path) for kind, path in self.files.items()},
        }


def feel(
    path: Path,
    folder: Path,
    settings: Settings,
    *,
    stem: str = "",
    channels: Sequence[int] = (),
    plot: bool = False,
    timeline_json: bool = False,
    report: Callable[[int, int], None] = ignore,
) -> Felt:
    """Process a recording and write its vibration, timeline and, if wanted, a figure.

    - ``folder``, ``stem``: where the files go, and how their names begin: by default as
      the recording's.
    - ``channels``: which of the file's channels are contact and air, counted from 0.
    - ``settings``: model, contact, threshold, events, tip, profile and ceiling are
      used.
    - ``report``: called with the samples processed and their number.

    Raises `DatasetError` if the recording cannot be read, `ModelError` if the model
    does not fit it, and `ConfigError` if the results cannot be written.
    """
    detector = settings.detector
    tip = settings.capture.tip
    profile = settings.rendering.profile
    recording = open_recording_for(path, settings, channels=channels)
    pipeline = recording.pipeline
    outputs = OutputFiles.in_folder(folder, stem or path.stem, json=timeline_json)
    events: list[TouchEvent] = []

    def follow(step: PipelineStep) -> None:
        recording.check_fit()
        events.extend(
            event for prediction in step.predictions for event in prediction.events
        )
        report(step.block.end, recording.size)

    summary, renderer = process_recording(
        recording.sound,
        pipeline,
        outputs,
        duration=recording.duration,
        on_step=follow,
    )
    files = {"vibration": outputs.waveform, "timeline": outputs.timeline}
    if detector.events or profile == "events":
        files["events"] = folder / f"{stem or path.stem}.events.csv"
        lines = ["time,event", *(f"{event.time:.4f},{event.kind}" for event in events)]
        make_room(files["events"])
        files["events"].write_text("\n".join(lines) + "\n", encoding="utf-8")
    if outputs.timeline_json:
        files["timeline_json"] = outputs.timeline_json
    truth = ground_truth(path, duration=recording.duration)
    labels = {segment.label_name for segment in truth}
    label = labels.pop() if len(labels) == 1 else "mixed" * bool(labels)
    if plot:
        files["figure"] = folder / f"{stem or path.stem}.feel.png"
        labelled = f", labelled {label}" if label else ""
        draw_recording(
            files["figure"],
            timeline=outputs.timeline,
            microphones=renderer.microphones,
            vibration=renderer.vibration,
            title=(
                f"{path.name}{labelled}; model {pipeline.detector.name}, profile "
                f"{pipeline.profile.name}"
            ),
            truth=truth,
        )
    return Felt(
        path,
        pipeline,
        profile,
        recording.sound.channels == 1 and not detector.model and tip == DEFAULT_TIP,
        label,
        truth,
        summary,
        files,
        recording.floor,
        recording.notes,
        score_run(read_timeline(outputs.timeline), truth) if label else None,
        Counter(event.kind for event in events),
        tip_mismatch(recording.card, tip) if recording.card else "",
    )


@dataclass(frozen=True, slots=True)
class FoundSound:
    """Sound to feel: a recording, or what was written of the log that it is from."""

    path: Path
    origin: Path
    """The recording itself, or the log."""


def sounds_of(
    paths: Iterable[Path],
    folder: Path,
    *,
    finger: str = "",
    report: Callable[[str], None] = ignore,
) -> Iterator[FoundSound]:
    """Yield recordings, those in a folder, and a log's sound: of each finger, or of
    one.

    The sound of each log is written to a folder of its own in ``folder``, where it
    takes the place of no recording and of no other log's sound.

    ``report`` is called with what is wrong with a log, which is then left out. Raises
    `ConfigError` if a finger is named, but there is no log.
    """
    from tactophone.live.log.mcap import is_mcap

    found = {
        path: [sound for sound in sounds_in(path) if ".haptic." not in sound.name]
        or [path]
        for path in paths
    }
    paths = [sound for sounds in found.values() for sound in sounds]
    if finger and not any(map(is_mcap, paths)):
        raise ConfigError(
            "--finger chooses a finger of a log, an MCAP file that --record wrote: "
            "leave it out"
        )
    for number, path in enumerate(paths):
        if not is_mcap(path):
            yield FoundSound(path, path)
            continue
        # Needed for logs alone, with the extras link and record.
        from tactophone.app.logged_run import write_sound

        try:
            yield from [
                FoundSound(sound.path, path)
                for sound in write_sound(path, folder / str(number), finger=finger)
            ]
        except TactophoneError as error:
            report(str(error))


def unique_stems(sounds: Iterable[FoundSound]) -> list[tuple[FoundSound, str]]:
    """Name the results of each recording after it; a second ``a.wav`` from another
    folder becomes ``a-2``."""
    taken: set[str] = set()
    stems = []
    for sound in sounds:
        stem = sound.path.stem
        number = 2
        while stem in taken:
            stem = f"{sound.path.stem}-{number}"
            number += 1
        taken.add(stem)
        stems.append((sound, stem))
    return stems
