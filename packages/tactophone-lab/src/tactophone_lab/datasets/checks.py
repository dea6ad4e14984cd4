"""Checks of single recordings, of a set as a whole, and of pairs of mono files; a bad
file never stops the others.

Two recorders start at different moments and their clocks drift; a detector that
compares the microphones within a window then compares different touches. A touch is
loud in both microphones, so the levels of the two files rise and fall together: the lag
is where the levels correlate best, measured in the first and in the last half.
"""

import hashlib
from collections import Counter
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from tactophone.core.errors import DatasetError
from tactophone.core.microphones import CONTACT
from tactophone.core.recordings.sound_file import LEAST_LOST, Length, length_of
from tactophone.core.recordings.values import (
    CHECKED_SILENT_DBFS,
    READ_SIZE,
    Dataset,
    Problem,
    Recording,
    channel_order,
    open_sound,
)
from tactophone.core.types import SURFACE_LABELS, FloatArray, ignore
from tactophone.signal.perception.health import FAULT_CLIPPED_SHARE, clipped_samples

MIN_RATE = 2000
"""Hz; the paper's detector works at this rate, and upsampling to it adds nothing."""

MIN_DURATION = 0.256
"""Seconds; one window of the paper's detector."""

MOST_CHANNELS = 2
"""Contact and air; of more channels it is unknown which two are meant."""

DEFAULT_CONTACT_DBFS = -60.0
"""RMS of a quarter second under which there is no contact on any set-up; a calibration
knows the exact level."""

CHECKED_MIN_CONTACT = 0.05
"""Share of a take that must be in contact."""

MIN_LABEL_SHARE = 0.25
"""Of the surfaces, for either label; the paper has 0.43 rough objects."""

CHECKED_CELL = 0.25
"""Seconds over which a level is measured."""

MOST_ZEROS = 0.5
"""Seconds of exact zeros at a file's end. A microphone's noise is never that quiet, but
some programs reserve a file's whole length before they copy it."""

LAG_CELL = 1e-3
"""Seconds over which a level is measured, and so the resolution of a lag."""

LONGEST_LAG = 1.0
"""Seconds within which a lag is looked for."""

MOST_LAG = 5e-3
"""Seconds; half a buffer of the paper's, from one prediction to the next. Sound takes
0.06 ms over the 2 cm from the surface to the air microphone."""

LEAST_CORRELATION = 0.3
"""Under it the levels do not rise and fall together, and no lag can be stated."""

MOST_DIFFERENCE = 0.1
"""Seconds by which the lengths may differ; the longer file is cut."""

LAG_FLOOR = 1e-8
"""Power, -80 dBFS, under which a level is noise of the converter."""


@dataclass(frozen=True, slots=True)
class _Measurements:
    """What one pass over a file measures."""

    sample_rate: int
    channels: int
    size: int
    sounding: int
    """Samples up to the last that is not zero."""
    length: Length
    peaks: tuple[float, ...]
    clipped: tuple[int, ...]
    finite: bool


def check(
    dataset: Dataset, *, progress: Callable[[int], None] = ignore
) -> tuple[Problem, ...]:
    """Read every recording to its end and report what is wrong, after what opening
    found; a bad one stops nothing."""
    problems = [*dataset.problems, *_label_conflicts(dataset)]
    if not dataset.recordings and not problems:
        problems.append(
            Problem(
                dataset.root,
                "empty",
                "its manifest names no recording; add a line for each",
            )
        )
    for done, recording in enumerate(dataset.recordings, 1):
        problems.extend(check_recording(recording))
        progress(done)
    return tuple(problems)


def nothing_usable(dataset: Dataset, problems: Sequence[Problem]) -> DatasetError:
    """Return the error for a data set with no usable recording, with the first
    reason."""
    bad = [problem for problem in problems if problem.fatal]
    count = max(len(dataset.recordings), len(bad))
    first = f"; {bad[0]}" if bad else ""
    return DatasetError(
        f"{dataset.root}: none of its {count} recordings can be used{first}"
    )


def usable(
    dataset: Dataset, *, progress: Callable[[int], None] = ignore
) -> tuple[Dataset, tuple[Problem, ...]]:
    """Return the data set without the recordings that cannot be used, and every problem
    found."""
    problems = check(dataset, progress=progress)
    bad = {problem.path for problem in problems if problem.fatal}
    return dataset.where(lambda recording: recording.path not in bad), problems


def channels_of_all(dataset: Dataset) -> int:
    """Return 2 if every recording that can be read has two channels or more, else 1."""
    found = set()
    for recording in dataset.recordings:
        with suppress(DatasetError), open_sound(recording.path) as file:
            found.add(int(file.channels))
    return 1 if not found or 1 in found else 2


def with_channels(dataset: Dataset, count: int) -> tuple[Dataset, tuple[Problem, ...]]:
    """Return the data set without recordings that lack a microphone, and a warning for
    each of these.

    ``count`` is 1 or 2. If no recording has as many microphones, all stay, so that
    whoever reads them can say which option to change.
    """

    def holds(recording: Recording) -> bool:
        try:
            with open_sound(recording.path) as file:
                return max(channel_order(recording, count=count)) < int(file.channels)
        except DatasetError:
            return False

    lacking = [recording for recording in dataset.recordings if not holds(recording)]
    if count == 1 or not lacking or len(lacking) == len(dataset.recordings):
        return dataset, ()
    message = (
        "one microphone, but the others of the set have contact and air; train "
        "on one with --channels 1"
    )
    paths = {recording.path for recording in lacking}
    problems = tuple(
        Problem(recording.path, "channels", message, fatal=False)
        for recording in lacking
    )
    return dataset.where(lambda recording: recording.path not in paths), problems


def with_picked_channels(dataset: Dataset, places: Sequence[int]) -> Dataset:
    """Return a data set in which contact and air are at these places of every file that
    has more channels than a finger; other files stay as they are."""

    def picked(recording: Recording) -> Recording:
        with suppress(DatasetError), open_sound(recording.path) as file:
            if file.channels > MOST_CHANNELS or max(places) < file.channels:
                return recording.with_picked(places, file.channels)
        return recording

    if not places:
        return dataset
    return replace(dataset, recordings=tuple(map(picked, dataset.recordings)))


def check_recording(recording: Recording) -> Iterator[Problem]:
    """Report what is wrong with one recording: missing, empty, broken, silent, clipped,
    or unlike its manifest."""
    path = recording.path
    if not path.is_file():
        yield Problem(
            path,
            "missing",
            "the manifest names it, but there is no such file; restore it or drop its "
            "line",
        )
        return
    if path.stat().st_size == 0:
        yield Problem(path, "empty", "0 bytes; record it again or drop its line")
        return
    try:
        measured = _measure(recording)
    except DatasetError as error:
        yield Problem(path, "broken", str(error).removeprefix(f"{path}: "))
        return
    for kind, message, fatal in (
        *_sound_faults(measured),
        *_manifest_faults(recording, measured),
    ):
        yield Problem(path, kind, message, fatal)


def _measure(recording: Recording) -> _Measurements:
    with open_sound(recording.path) as file:
        peaks = np.zeros(file.channels)
        railed = np.zeros(file.channels, int)
        size = 0
        sounding = 0
        finite = True
        for samples in file.blocks(READ_SIZE, dtype="float32", always_2d=True):
            magnitude = np.abs(samples)
            finite = finite and bool(np.isfinite(magnitude).all())
            peaks = np.maximum(peaks, np.nan_to_num(magnitude.max(axis=0), posinf=0.0))
            railed += clipped_samples(samples.T).sum(axis=1)
            heard = np.flatnonzero(samples.any(axis=1))
            sounding = size + int(heard[-1]) + 1 if heard.size else sounding
            size += len(samples)
        peak = tuple(peaks.tolist())
        counts = tuple(railed.tolist())
        return _Measurements(
            file.samplerate,
            file.channels,
            size,
            sounding,
            length_of(recording.path),
            peak,
            counts,
            finite,
        )


def _sound_faults(measured: _Measurements) -> Iterator[tuple[str, str, bool]]:
    duration = measured.size / measured.sample_rate
    if measured.size == 0:
        yield "empty", "a header without sound; record it again or drop its line", True
        return
    if measured.length.cut:
        found = measured.length.words(duration)
        trifle = measured.length.lost(duration) < LEAST_LOST
        advice = "the rest is used" if trifle else "restore the whole file"
        yield "broken", f"{found}; {advice}", not trifle
    zeros = (measured.size - measured.sounding) / measured.sample_rate
    if measured.sounding and zeros > MOST_ZEROS:
        found = f"its last {zeros:.1f} s are exact zeros, as in a copy that broke off"
        yield "zeros", f"{found}; compare its size with the original's", False
    if not measured.finite:
        yield "broken", "holds NaN or infinite samples; export it again", True
        return  # its levels say nothing
    if measured.sample_rate < MIN_RATE:
        yield (
            "rate",
            f"{measured.sample_rate} Hz, but at least {MIN_RATE} Hz is needed; record "
            "it again",
            True,
        )
    if duration < MIN_DURATION:
        yield (
            "short",
            f"{duration:.3f} s, less than one window of {MIN_DURATION} s; record it "
            "again or drop it",
            True,
        )
    threshold = 10 ** (CHECKED_SILENT_DBFS / 20)
    silent = [
        str(number) for number, peak in enumerate(measured.peaks, 1) if peak < threshold
    ]
    if silent:
        whole = len(silent) == measured.channels
        where = (
            "every channel"
            if whole
            else f"channel {', '.join(silent)} of {measured.channels}"
        )
        yield (
            "silent",
            f"{where} stays under {CHECKED_SILENT_DBFS:.0f} dBFS; check the "
            "microphone and its gain",
            whole,
        )
    if max(measured.clipped) > FAULT_CLIPPED_SHARE * measured.size:
        share = sum(measured.clipped) / (measured.size * measured.channels)
        yield (
            "clipped",
            f"{share:.2%} of its samples lie at full scale; record it again with less "
            "gain",
            False,
        )


def _manifest_faults(
    recording: Recording, measured: _Measurements
) -> Iterator[tuple[str, str, bool]]:
    if recording.channels and len(recording.channels) != measured.channels:
        found = (
            f"the manifest names {len(recording.channels)} channels, but the file "
            f"has {measured.channels}"
        )
        yield "channels", f"{found}; correct the column channels", True
    elif not recording.channels and measured.channels > MOST_CHANNELS:
        found = f"{measured.channels} channels, but a finger has contact and air"
        yield (
            "channels",
            f"{found}; name them with --channels, such as --channels 3,4",
            True,
        )
    duration = measured.size / measured.sample_rate
    for segment in recording.segments:
        # One millisecond of tolerance: manifests round.
        if not 0 <= segment.start < segment.end <= duration + 1e-3:
            found = f"{segment.start:g}-{segment.end:g} s of {duration:.3f} s"
            yield "segments", f"a segment lies at {found}; correct its times", False


def _label_conflicts(dataset: Dataset) -> Iterator[Problem]:
    seen: dict[str, Recording] = {}
    for recording in dataset.recordings:
        if not recording.labelled:
            continue
        first = seen.setdefault(recording.surface, recording)
        if first.label is not recording.label:
            labels = (
                f"{recording.known('label')} here, {first.known('label')} in "
                f"{first.path.name}"
            )
            message = (
                f"{recording.surface} is {labels}; give each surface a single label"
            )
            yield Problem(recording.path, "label", message, fatal=False)


def check_consistency(
    dataset: Dataset,
    *,
    threshold_dbfs: float = DEFAULT_CONTACT_DBFS,
    progress: Callable[[int], None] = ignore,
) -> tuple[Problem, ...]:
    """Read every readable recording, and report what is wrong with the set as a whole.

    Faults of single files are reported by :func:`check` instead. ``threshold_dbfs`` is
    the level of contact over a quarter second; ``progress`` is called with the number
    of recordings done.
    """
    from tactophone_lab.datasets.shared_sound import (
        leaks_between_surfaces,
        passages_of,
        shared_sound,
    )

    problems = [*_leaks(dataset), *_imbalance(dataset)]
    seen: dict[str, Recording] = {}
    passages: list[tuple[Recording, Mapping[bytes, int]]] = []
    for done, recording in enumerate(dataset.recordings, 1):
        measured = _measure_contact(recording, threshold_dbfs)
        if measured is not None:
            digest, contact, heard = measured
            first = seen.setdefault(digest, recording)
            problems += _duplicate(recording, first)
            if first is recording:  # a duplicate shares all of its sound
                passages.append((recording, passages_of(heard)))
            if recording.labelled and contact < CHECKED_MIN_CONTACT:
                found = (
                    f"over {threshold_dbfs:.0f} dBFS for only {contact:.0%} of the time"
                )
                message = f"{found}; record it again, or label it none"
                problems.append(
                    Problem(recording.path, "no contact", message, fatal=False)
                )
        progress(done)
    problems += leaks_between_surfaces(shared_sound(passages))
    return tuple(problems)


def _leaks(dataset: Dataset) -> Iterator[Problem]:
    sides: dict[str, set[str]] = {}
    for recording in dataset.recordings:
        if side := recording.known("split"):
            sides.setdefault(recording.surface, set()).add(side)
    for surface, names in sorted(sides.items()):
        if len(names) > 1:
            message = (
                f"{surface} is in {' and '.join(sorted(names))}; keep each "
                "surface on one side"
            )
            yield Problem(dataset.root, "leak", message, fatal=False)


def _imbalance(dataset: Dataset) -> Iterator[Problem]:
    surfaces = {
        recording.surface: recording.label
        for recording in dataset.recordings
        if recording.labelled
    }
    counts = Counter(surfaces.values())
    for label in SURFACE_LABELS:
        if surfaces and counts[label] < MIN_LABEL_SHARE * len(surfaces):
            message = (
                f"{counts[label]} of {len(surfaces)} surfaces are "
                f"{label.name.lower()}; record more of them"
            )
            yield Problem(dataset.root, "unbalanced", message, fatal=False)


def _duplicate(recording: Recording, first: Recording) -> Iterator[Problem]:
    if first is recording:
        return
    if first.path == recording.path and first.label is recording.label:
        yield Problem(
            recording.path,
            "duplicate",
            "the manifest names it twice; drop either line",
            fatal=False,
        )
        return
    message = f"the same sound as {first.path.name}"
    if first.label is not recording.label:
        here = recording.known("label") or "-"
        there = first.known("label") or "-"
        message += f", but labelled {here} here and {there} there"
    elif first.known("split") != recording.known("split"):
        here = recording.known("split") or "-"
        there = first.known("split") or "-"
        message += f", which is in {there} and this in {here}"
    yield Problem(
        recording.path, "duplicate", f"{message}; drop either file", fatal=False
    )


def _measure_contact(
    recording: Recording, threshold_dbfs: float
) -> tuple[str, float, FloatArray] | None:
    """Return a hash of the sound, whatever its container, the share of it in contact,
    and the contact microphone's samples; nothing if unusable."""
    try:
        sound = recording.read()
    except DatasetError:
        return None
    # Rounded to 1e-4, a copy in 16 or 24 bits is the same sound, and two recordings
    # still differ.
    samples = sound.samples.round(4)
    rate = sound.sample_rate
    channel = (
        recording.channels.index("contact")
        if "contact" in recording.channels
        else CONTACT
    )
    if not samples.size or sound.invalid is not None:
        return None  # reported as a fault of the file
    size = max(1, int(CHECKED_CELL * rate))
    # Whole cells only, shape (cells, size): a rest shorter than a cell would bias the
    # share.
    cells = samples[: len(samples) // size * size, channel].reshape(-1, size)
    power = (
        np.square(cells, dtype=np.float64).mean(axis=1) if len(cells) else np.zeros(1)
    )
    digest = hashlib.sha256(f"{rate}".encode() + samples.tobytes()).hexdigest()
    contact = float(np.mean(power >= 10 ** (threshold_dbfs / 10)))
    return digest, contact, sound.samples[:, channel]


def pair_fault(contact: Path, air: Path) -> tuple[str, bool]:
    """Return what is wrong with a pair of mono files, empty if nothing, and whether it
    forbids to join them."""
    try:
        one, two = (_shape(path) for path in (contact, air))
    except DatasetError as error:
        return f"its pair cannot be read: {error}", True
    name = air.name
    rate = one.sample_rate
    if one.channels != 1 or two.channels != 1:
        return (
            f"it and {name} hold {one.channels} and {two.channels} channels; two mono "
            "files make a pair",
            True,
        )
    if rate != two.sample_rate:
        return (
            f"{rate} Hz, but {name} has {two.sample_rate} Hz; resample one of them "
            "first",
            True,
        )
    difference = abs(one.size - two.size) / rate
    if difference > MOST_DIFFERENCE:
        return (
            f"{name} differs in length by {difference:.3f} s; cut both to the same "
            "touch",
            True,
        )
    size = min(one.size, two.size)
    try:
        powers = [_cell_powers(path, size, rate) for path in (contact, air)]
    except DatasetError as error:
        return f"its pair cannot be read: {error}", True
    middle = len(powers[0]) // 2
    lags = [
        _lag(*(_level_of(power[half]) for power in powers))
        for half in (slice(middle), slice(middle, None))
    ]
    if min(correlation for _, correlation in lags) < LEAST_CORRELATION:
        return (
            f"whether {name} is in step is unknown: the levels do not correlate",
            False,
        )
    begin, end = (1000 * seconds for seconds, _ in lags)
    if max(abs(begin), abs(end)) <= 1000 * MOST_LAG:
        return "", False
    if abs(end - begin) > 1000 * MOST_LAG:
        return (
            f"{name} drifts: {begin:+.0f} ms in its first half, {end:+.0f} ms in its "
            "last; use one clock",
            True,
        )
    return (
        f"{name} is {begin:+.0f} ms out of step; shift it by that and import again",
        True,
    )


class _Shape(NamedTuple):
    sample_rate: int
    channels: int
    size: int


def _shape(path: Path) -> _Shape:
    with open_sound(path) as file:
        return _Shape(file.samplerate, file.channels, len(file))


def _cell_powers(path: Path, size: int, rate: int) -> NDArray[np.float64]:
    """Return the power of each cell of a mono file, read in blocks: an hour of silence
    is a small file."""
    cell = max(1, round(LAG_CELL * rate))
    last = None
    parts = [np.empty(0)]
    with open_sound(path) as file:
        for block in file.blocks(
            cell * max(1, READ_SIZE // cell), dtype="float32", frames=size
        ):
            # The difference of neighbours is a high-pass: hum and handling noise are
            # not the touch.
            change = np.diff(block, prepend=block[:1] if last is None else last).astype(
                np.float64
            )
            last = block[-1:]
            parts.append(
                np.square(change[: len(change) // cell * cell])
                .reshape(-1, cell)
                .mean(axis=1)
            )
    return np.concatenate(parts)


def _lag(*levels: NDArray[np.float64]) -> tuple[float, float]:
    """Return by how many s the second of two levels is late, and their correlation at
    it."""
    count = min(map(len, levels))
    reach = round(LONGEST_LAG / LAG_CELL)
    levels = tuple(level[:count] for level in levels)
    norm = float(np.linalg.norm(levels[0]) * np.linalg.norm(levels[1]))
    if count < 2 or norm == 0:
        return 0.0, 0.0
    # Padded to twice the length, the circular correlation is the linear one.
    spectra = [np.fft.rfft(level, 2 * count) for level in levels]
    correlation = np.fft.irfft(spectra[1] * spectra[0].conj(), 2 * count) / norm
    lags = np.arange(-min(reach, count - 1), min(reach, count - 1) + 1)
    best = int(lags[np.argmax(correlation[lags])])
    return best * LAG_CELL, float(correlation[best])


def _level_of(power: NDArray[np.float64]) -> NDArray[np.float64]:
    level = 10 * np.log10(power + LAG_FLOOR)
    return np.asarray(level - level.mean()) if len(level) else level
