"""Checks of single recordings: each bad file is reported, and none stops the others."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np

from tactophone.dataset.values import READ_SIZE, Dataset, Problem, Recording, channel_order, open_sound
from tactophone.errors import DatasetError
from tactophone.types import Touch

MIN_RATE = 2000
"""Hz; the paper's detector works at this rate, and upsampling to it adds nothing."""

MIN_DURATION = 0.256
"""Seconds; one window of the paper's detector."""

SILENT_DBFS = -90.0
"""Peak under which nothing was recorded: three steps of a 16-bit converter."""

MOST_CHANNELS = 2
"""Contact and air. Which two of more would be meant nobody has said."""

CLIPPED_LEVEL = 0.999
CLIPPED_SHARE = 1e-3
"""A recording is clipped when more than this share of its samples is at full scale; single taps may reach it."""


@dataclass(frozen=True, slots=True)
class _Measurements:
    """What one pass over a file measures; ``promised`` is the length in its header, in samples."""

    sample_rate: int
    channels: int
    size: int
    promised: int
    peaks: tuple[float, ...]
    clipped: int
    finite: bool


def check(dataset: Dataset, *, progress: Callable[[int], None] = lambda done: None) -> tuple[Problem, ...]:
    """Read every recording to its end and report what is wrong, after what opening found; a bad one stops nothing."""
    problems = [*dataset.problems, *_label_conflicts(dataset)]
    if not dataset.recordings and not problems:
        problems.append(Problem(dataset.root, "empty", "its manifest names no recording; add a line for each"))
    for done, recording in enumerate(dataset.recordings, 1):
        problems.extend(check_recording(recording))
        progress(done)
    return tuple(problems)


def usable(dataset: Dataset) -> tuple[Dataset, tuple[Problem, ...]]:
    """Return the data set without the recordings that cannot be used, and every problem found."""
    problems = check(dataset)
    bad = {problem.path for problem in problems if problem.fatal}
    return dataset.where(lambda recording: recording.path not in bad), problems


def with_channels(dataset: Dataset, count: int) -> tuple[Dataset, tuple[Problem, ...]]:
    """Return the data set without recordings that lack a microphone, and a warning for each of these.

    ``count`` is 1 or 2. If no recording has as many microphones, all stay, so that whoever reads them can say which
    option to change.
    """
    lacking = [recording for recording in dataset.recordings if not _holds(recording, count)]
    if count == 1 or not lacking or len(lacking) == len(dataset.recordings):
        return dataset, ()
    message = "one microphone, but the others of the set have contact and air; train on one with --channels 1"
    paths = {recording.path for recording in lacking}
    problems = tuple(Problem(recording.path, "channels", message, fatal=False) for recording in lacking)
    return dataset.where(lambda recording: recording.path not in paths), problems


def _holds(recording: Recording, count: int) -> bool:
    try:
        with open_sound(recording.path) as file:
            return max(channel_order(recording, count=count)) < int(file.channels)
    except DatasetError:
        return False


def check_recording(recording: Recording) -> Iterator[Problem]:
    """Report what is wrong with one recording: missing, empty, broken, silent, clipped, or unlike its manifest."""
    path = recording.path
    if not path.is_file():
        yield Problem(path, "missing", "the manifest names it, but there is no such file; restore it or drop its line")
        return
    if path.stat().st_size == 0:
        yield Problem(path, "empty", "0 bytes; record it again or drop its line")
        return
    try:
        measured = _measure(recording)
    except DatasetError as error:
        yield Problem(path, "broken", str(error).removeprefix(f"{path}: "))
        return
    for kind, message, fatal in (*_sound_faults(measured), *_manifest_faults(recording, measured)):
        yield Problem(path, kind, message, fatal)


def _measure(recording: Recording) -> _Measurements:
    with open_sound(recording.path) as file:
        peaks, clipped, size, finite = np.zeros(file.channels), 0, 0, True
        for samples in file.blocks(READ_SIZE, dtype="float32", always_2d=True):
            magnitude = np.abs(samples)
            finite = finite and bool(np.isfinite(magnitude).all())
            peaks = np.maximum(peaks, np.nan_to_num(magnitude.max(axis=0), posinf=0.0))
            clipped += int((magnitude >= CLIPPED_LEVEL).sum())
            size += len(samples)
        return _Measurements(file.samplerate, file.channels, size, len(file), tuple(peaks.tolist()), clipped, finite)


def _sound_faults(measured: _Measurements) -> Iterator[tuple[str, str, bool]]:
    duration = measured.size / measured.sample_rate
    if measured.size == 0:
        yield "empty", "a header without sound; record it again or drop its line", True
        return
    if measured.size < measured.promised:
        yield "broken", f"ends after {measured.size} of {measured.promised} samples; restore the whole file", True
    if not measured.finite:
        yield "broken", "holds NaN or infinite samples; export it again", True
        return  # its levels say nothing
    if measured.sample_rate < MIN_RATE:
        yield "rate", f"{measured.sample_rate} Hz, but at least {MIN_RATE} Hz is needed; record it again", True
    if duration < MIN_DURATION:
        yield "short", f"{duration:.3f} s, less than one window of {MIN_DURATION} s; record it again or drop it", True
    threshold = 10 ** (SILENT_DBFS / 20)
    silent = [str(number) for number, peak in enumerate(measured.peaks) if peak < threshold]
    if silent:
        whole = len(silent) == measured.channels
        where = "every channel" if whole else f"channel {', '.join(silent)}"
        yield "silent", f"{where} stays under {SILENT_DBFS:.0f} dBFS; check the microphone and its gain", whole
    share = measured.clipped / (measured.size * measured.channels)
    if share > CLIPPED_SHARE:
        yield "clipped", f"{share:.2%} of its samples lie at full scale; record it again with less gain", False


def _manifest_faults(recording: Recording, measured: _Measurements) -> Iterator[tuple[str, str, bool]]:
    if recording.channels and len(recording.channels) != measured.channels:
        found = f"the manifest names {len(recording.channels)} channels, but the file has {measured.channels}"
        yield "channels", f"{found}; correct the column channels", True
    elif measured.channels > MOST_CHANNELS:
        found = f"{measured.channels} channels, but a finger has contact and air"
        yield "channels", f"{found}; export these two as a file of their own", True
    duration = measured.size / measured.sample_rate
    for segment in recording.segments:
        # One millisecond of tolerance: manifests round.
        if not 0 <= segment.start < segment.end <= duration + 1e-3:
            found = f"{segment.start:g}-{segment.end:g} s of {duration:.3f} s"
            yield "segments", f"a segment lies at {found}; correct its times", False


def _label_conflicts(dataset: Dataset) -> Iterator[Problem]:
    seen: dict[str, Recording] = {}
    for recording in dataset.recordings:
        if recording.label not in (Touch.SMOOTH, Touch.ROUGH):
            continue
        first = seen.setdefault(recording.surface, recording)
        if first.label is not recording.label:
            labels = f"{recording.known('label')} here, {first.known('label')} in {first.path.name}"
            message = f"{recording.surface} is {labels}; give each surface a single label"
            yield Problem(recording.path, "label", message, fatal=False)
