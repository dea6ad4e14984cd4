"""Finds what is wrong with recordings, file by file, so that one bad file costs nobody a night's training."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass

import numpy as np
import soundfile

from tactophone.dataset.values import Dataset, Problem, Recording
from tactophone.types import Touch

READ_SIZE = 1 << 16
"""Samples read at once: more is no faster, and memory must not grow with a recording's length."""

LOWEST_RATE = 2000
"""Hz; the paper's detector works at this rate, and nothing can be gained by going up to it."""

SHORTEST = 0.256
"""Seconds; one window of the paper's detector."""

SILENT_DBFS = -90.0
"""Peak under which nothing was recorded: three steps of a 16-bit converter."""

CLIPPED_LEVEL = 0.999
CLIPPED_SHARE = 1e-3
"""A recording is clipped when more than this share of its samples lies at full scale; single taps may touch it."""


@dataclass(frozen=True, slots=True)
class _Survey:
    sample_rate: int
    channels: int
    size: int
    promised: int
    peaks: tuple[float, ...]
    clipped: int
    finite: bool


def check(dataset: Dataset, *, progress: Callable[[int], None] = lambda done: None) -> tuple[Problem, ...]:
    """Read every recording through and name what is wrong; nothing stops at a bad one.

    Parameters
    ----------
    dataset
        Problems met while opening it come first.
    progress
        Called with the number of recordings done.
    """
    found = [*dataset.problems, *_conflicts(dataset)]
    for done, recording in enumerate(dataset.recordings, 1):
        found.extend(check_recording(recording))
        progress(done)
    return tuple(found)


def usable(dataset: Dataset) -> tuple[Dataset, tuple[Problem, ...]]:
    """Leave out the recordings that cannot be used; give the rest, and every problem found."""
    problems = check(dataset)
    bad = {problem.path for problem in problems if problem.fatal}
    return dataset.where(lambda recording: recording.path not in bad), problems


def check_recording(recording: Recording) -> Iterator[Problem]:
    """Name what is wrong with one recording: missing, empty, broken, silent, clipped, or told falsely."""
    path = recording.path
    if not path.is_file():
        yield Problem(path, "missing", "the manifest names it, but there is no such file; restore it or drop its line")
        return
    if path.stat().st_size == 0:
        yield Problem(path, "empty", "0 bytes; record it again or drop its line")
        return
    try:
        survey = _survey(recording)
    except (soundfile.LibsndfileError, RuntimeError, OSError) as error:
        yield Problem(path, "broken", f"cannot be read as sound ({_reason(error)}); restore it or drop its line")
        return
    for kind, message, fatal in (*_sound_faults(survey), *_told_falsely(recording, survey)):
        yield Problem(path, kind, message, fatal)


def _survey(recording: Recording) -> _Survey:
    with soundfile.SoundFile(recording.path) as file:
        peaks, clipped, size, finite = np.zeros(file.channels), 0, 0, True
        for samples in file.blocks(READ_SIZE, dtype="float32", always_2d=True):
            loud = np.abs(samples)
            finite = finite and bool(np.isfinite(loud).all())
            peaks = np.maximum(peaks, np.nan_to_num(loud.max(axis=0), posinf=0.0))
            clipped += int((loud >= CLIPPED_LEVEL).sum())
            size += len(samples)
        return _Survey(file.samplerate, file.channels, size, len(file), tuple(peaks.tolist()), clipped, finite)


def _sound_faults(survey: _Survey) -> Iterator[tuple[str, str, bool]]:
    duration = survey.size / survey.sample_rate
    if survey.size == 0:
        yield "empty", "a header without sound; record it again or drop its line", True
        return
    if survey.size < survey.promised:
        yield "broken", f"ends after {survey.size} of {survey.promised} samples; restore the whole file", True
    if not survey.finite:
        yield "broken", "holds NaN or infinite samples; export it again", True
    if survey.sample_rate < LOWEST_RATE:
        yield "rate", f"{survey.sample_rate} Hz, but {LOWEST_RATE} Hz or more is wanted; record it again", True
    if duration < SHORTEST:
        yield "short", f"{duration:.3f} s, less than one window of {SHORTEST} s; record it again or drop it", True
    threshold = 10 ** (SILENT_DBFS / 20)
    silent = [str(number) for number, peak in enumerate(survey.peaks) if peak < threshold]
    if silent:
        whole = len(silent) == survey.channels
        where = "every channel" if whole else f"channel {', '.join(silent)}"
        yield "silent", f"{where} stays under {SILENT_DBFS:.0f} dBFS; look to the microphone and its gain", whole
    share = survey.clipped / (survey.size * survey.channels)
    if share > CLIPPED_SHARE:
        yield "clipped", f"{share:.2%} of its samples lie at full scale; record it again with less gain", False


def _told_falsely(recording: Recording, survey: _Survey) -> Iterator[tuple[str, str, bool]]:
    if recording.channels and len(recording.channels) != survey.channels:
        told = f"the manifest names {len(recording.channels)} channels, but the file has {survey.channels}"
        yield "channels", f"{told}; correct the column channels", True
    duration = survey.size / survey.sample_rate
    for segment in recording.segments:
        # One millisecond of grace: manifests round.
        if not 0 <= segment.start < segment.end <= duration + 1e-3:
            told = f"{segment.start:g}-{segment.end:g} s of {duration:.3f} s"
            yield "segments", f"a segment lies at {told}; correct its times", False


def _conflicts(dataset: Dataset) -> Iterator[Problem]:
    seen: dict[str, Recording] = {}
    for recording in dataset.recordings:
        if recording.label not in (Touch.SMOOTH, Touch.ROUGH):
            continue
        first = seen.setdefault(recording.surface, recording)
        if first.label is not recording.label:
            told = (
                f"{recording.surface} is {recording.known('label')} here, {first.known('label')} in {first.path.name}"
            )
            yield Problem(recording.path, "label", f"{told}; give a surface one label", fatal=False)


def _reason(error: Exception) -> str:
    return str(getattr(error, "error_string", error)).strip().rstrip(".")
