r"""Roughness of measured heights: of a profile by ISO 4287 and ISO 21920-2, of a map by ISO 25178-2.

The Gaussian filter (ISO 16610-21) has the weight :math:`s(x) = \exp(-\pi (x / \alpha\lambda_c)^2) / \alpha\lambda_c`
with :math:`\alpha = \sqrt{\ln 2 / \pi}`, so that half of a wave of the cut-off length passes. The filter passes
waviness; the rest is roughness. Half a cut-off at either end is not evaluated, unless the profile is periodic.

Choices where the standards leave room: RSm counts elements between up-crossings of the mean line whose peak and valley
both exceed a tenth of Rz; Rz is the mean over five sampling lengths, or as many as there are.

A map is levelled by its least-squares plane. A Gaussian filter (ISO 16610-61, separable) of a few micrometres takes out
noise where the heights are close enough for it, and one with the cut-off as nesting index takes out waviness. Half a
cut-off at each edge is not evaluated, as with profiles. Ra, Rz and RSm of a map are means over its rows.
"""

import math
from dataclasses import asdict, dataclass
from pathlib import Path
from zipfile import BadZipFile, ZipFile

import numpy as np
from numpy.typing import NDArray

from tactophone.core.errors import DatasetError

CUTOFF = 0.8e-3
"""Metres; ISO 21920-3's default for Ra of 0.1 to 2 um, and the scale of a finger pad."""

COARSE_CUTOFF = 2.5e-3
"""Metres; ISO 21920-3's default for Ra of 2 to 10 um."""

ALPHA = math.sqrt(math.log(2) / math.pi)
LENGTHS = 5
LEAST_ELEMENT = 0.1
"""Of Rz: the height discrimination of profile elements (ISO 4287, 3.1.6)."""

STANDARD_CUTOFFS = ((20e-9, 0.08e-3), (100e-9, 0.25e-3), (2e-6, 0.8e-3), (10e-6, 2.5e-3), (80e-6, 8e-3))
"""Greatest Ra and its cut-off, in m, of ISO 4288 and ISO 21920-3."""

SLOPE_WEIGHTS = np.array([1.0, -9.0, 45.0, 0.0, -45.0, 9.0, -1.0])
"""Weights of seven neighbours, newest first, in sixtieths of a step."""

UNITS = {"m": 1.0, "mm": 1e-3, "um": 1e-6, "nm": 1e-9}
SHORT_CUTOFFS = {0.08e-3: 2.5e-6, 0.25e-3: 2.5e-6, 0.8e-3: 2.5e-6, 2.5e-3: 8e-6, 8e-3: 25e-6}
"""Cut-off of the filter against noise for each cut-off of roughness, in m (ISO 3274, ISO 21920-3)."""

ROWS = 64
"""Most rows that are measured as profiles, evenly drawn: their mean hardly moves with more."""

MOST_HEIGHTS = 1 << 25
"""Heights in a file, 5,800 x 5,800; measuring them takes 64 bytes each and more. A larger map is not read."""

STEEPEST = 10.0
"""Slope, rms: 84 degrees. Steeper ones come from heights in another unit than stated."""

Heights = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Roughness:
    """Roughness parameters."""

    ra: float
    rq: float
    """`ra` and `rq`: mean of the absolute height, and its root mean square, in m."""
    rz: float
    """Greatest height within a sampling length, averaged over five, in m."""
    rsm: float
    """Mean width of profile elements, in m; NaN if there is none."""
    rdq: float
    """Root mean square slope, without unit."""


def measure_profile(heights: Heights, *, step: float, cutoff: float = CUTOFF, periodic: bool = False) -> Roughness:
    """Compute the roughness parameters of a profile: heights in m, ``step`` m apart, at a filter's cut-off in m.

    A periodic profile has no ends to leave out. Raises `ValueError` if one that is not is shorter than two cut-offs.

    >>> place = np.arange(0, 10e-3, 1e-6)
    >>> sine = measure_profile(5e-6 * np.sin(2 * np.pi * place / 0.1e-3), step=1e-6)
    >>> round(sine.ra * 1e6, 2), round(2 * 5 / math.pi, 2), round(sine.rsm * 1e3, 3), round(sine.rdq, 3)
    (3.18, 3.18, 0.1, 0.222)
    """
    rough = roughness_profile(heights, step=step, cutoff=cutoff, periodic=periodic)
    rough = rough - rough.mean()
    rq = float(np.sqrt(np.square(rough).mean()))
    size = max(1, round(cutoff / step))
    count = max(1, min(LENGTHS, len(rough) // size))
    rz = float(np.mean([part.max() - part.min() for part in np.array_split(rough[: count * size], count)]))
    rsm = _rsm(rough, LEAST_ELEMENT * rz) * step
    # The slope is that of seven heights, as ISO 21920-2 and ISO 4287 name it.
    padded = np.pad(rough, 3, mode="wrap") if periodic else rough
    slopes = np.convolve(padded, SLOPE_WEIGHTS, mode="valid") / (60 * step) if len(padded) >= 7 else np.array([np.nan])
    rdq = float(np.sqrt(np.square(slopes).mean()))
    return Roughness(float(np.abs(rough).mean()), rq, rz, rsm, rdq)


def roughness_profile(heights: Heights, *, step: float, cutoff: float = CUTOFF, periodic: bool = False) -> Heights:
    """Return heights less the Gaussian mean line, half a cut-off shorter at either end unless periodic.

    Parameters and errors are those of :func:`measure_profile`.
    """
    if periodic:
        wavenumber = np.fft.rfftfreq(heights.size, step)
        roughness_share = 1 - np.exp(-math.pi * np.square(ALPHA * cutoff * wavenumber))
        return np.asarray(np.fft.irfft(np.fft.rfft(heights) * roughness_share, heights.size))
    half = round(cutoff / 2 / step)
    if len(heights) < 4 * half or half < 2:
        raise ValueError(
            f"a profile of {len(heights)} heights {step:g} m apart is too short: at a cut-off of {cutoff:g} m it must "
            "be at least two cut-offs long, with five heights or more in each"
        )
    middle = heights - heights.mean()
    return np.asarray((middle - gaussian_line(middle, step=step, cutoff=cutoff))[half : len(middle) - half])


def gaussian_line(heights: Heights, *, step: float, cutoff: float) -> Heights:
    """Return the Gaussian mean line of profiles along the last axis (ISO 16610-21); near the ends it is pulled to 0.

    ``heights`` has the shape ``(..., heights)`` and mean zero; all are in m.
    """
    half = max(1, round(cutoff / 2 / step))
    place = np.arange(-2 * half, 2 * half + 1) * step / (ALPHA * cutoff)
    weights = np.exp(-math.pi * np.square(place))
    # By FFT: a cut-off may hold a thousand heights.
    size = heights.shape[-1] + len(weights) - 1
    spectrum = np.fft.rfft(heights, size) * np.fft.rfft(weights / weights.sum(), size)
    return np.asarray(np.fft.irfft(spectrum, size)[..., 2 * half : 2 * half + heights.shape[-1]])


def standard_cutoff(ra: float) -> float:
    """Return the cut-off in m that ISO 21920-3 (table for non-periodic profiles, as ISO 4288) names for an Ra in m.

    >>> standard_cutoff(1e-6), standard_cutoff(5e-6)
    (0.0008, 0.0025)
    """
    return next((cutoff for most, cutoff in STANDARD_CUTOFFS if ra <= most), STANDARD_CUTOFFS[-1][1])


def choose_cutoff(heights: Heights, *, step: float) -> tuple[float, bool]:
    """Choose a profile's cut-off in m by its own Ra; also whether it was long enough for the one that ISO names."""
    fitting = [cutoff for _, cutoff in STANDARD_CUTOFFS if 2 * cutoff <= step * len(heights) and cutoff >= 4 * step]
    if not fitting:
        raise ValueError(
            f"{len(heights)} heights {step:g} m apart are too few for any cut-off: the shortest of the standard is "
            f"{STANDARD_CUTOFFS[0][1]:g} m, and two must fit; measure a longer line"
        )
    # From the shortest: Ra grows with the cut-off, and the first that agrees with its own Ra is the standard's.
    for cutoff in fitting:
        if standard_cutoff(measure_profile(heights, step=step, cutoff=cutoff).ra) <= cutoff:
            return cutoff, True
    return fitting[-1], False


def _rsm(rough: Heights, least: float) -> float:
    """Mean width of elements, in heights: from one up-crossing to the next, peak and valley both high enough."""
    beyond = np.flatnonzero(np.abs(rough) >= least)
    sides = np.sign(rough[beyond])
    # Small wiggles between two excursions on the same side are not crossings.
    ups = np.flatnonzero((sides[:-1] < 0) & (sides[1:] > 0))
    crossings = []
    for low, high in zip(beyond[ups], beyond[ups + 1], strict=True):
        # Where the profile first rises through the mean line between the two, to a fraction of a step.
        part = rough[low : high + 1]
        at = int(np.flatnonzero((part[:-1] < 0) & (part[1:] >= 0))[0])
        crossings.append(low + at + float(part[at] / (part[at] - part[at + 1])))
    return float(np.diff(crossings).mean()) if len(crossings) > 1 else float("nan")


@dataclass(frozen=True, slots=True)
class ArealRoughness:
    """Areal parameters: mean of the absolute height, its root mean square, and the greatest height, in m."""

    sa: float
    sq: float
    sz: float


@dataclass(frozen=True, slots=True)
class HeightReport:
    """What was measured, with what, and what to beware of; lengths in m."""

    profile: Roughness
    area: ArealRoughness | None
    """`profile` and `area`: parameters; ``area`` is ``None`` for a single profile."""
    step: float
    cutoff: float
    """`step` and `cutoff`: between heights, and of the filter."""
    shape: tuple[int, int]
    """Of the heights as measured, rows and columns; one row for a profile."""
    notes: tuple[str, ...]
    """Doubts about the figures, a sentence each."""


def measure_heights(
    heights: Heights, *, step: float, cutoff: float | None = None, resolution: float = 0.0
) -> HeightReport:
    """Measure a profile or a height map, shape ``(heights,)`` or ``(rows, columns)``, ``step`` apart; all in m.

    The cut-off of the filter is by default the one that ISO 21920-3 names for the Ra found. Under ``resolution`` the
    sensor shows nothing but noise. Raises `ValueError` if there are too few heights for the cut-off.
    """
    rows = np.atleast_2d(levelled(heights))
    long_enough = True
    if cutoff is None:
        cutoff, long_enough = choose_cutoff(rows[len(rows) // 2], step=step)
    short = SHORT_CUTOFFS.get(cutoff, cutoff / 300)
    if fine_enough := 2 * step <= short:
        rows = _gaussian_mean(rows, step=step, cutoff=short)
    drawn = np.unique(np.linspace(0, len(rows) - 1, min(ROWS, len(rows))).round().astype(int))
    found = [measure_profile(rows[row], step=step, cutoff=cutoff) for row in drawn]
    columns = np.array([list(asdict(row).values()) for row in found]).T
    known = [column[np.isfinite(column)] for column in columns]
    profile = Roughness(*(float(values.mean()) if len(values) else math.nan for values in known))
    area = measure_area(rows, step=step, cutoff=cutoff) if len(rows) > 1 and len(rows) * step >= 2 * cutoff else None
    notes = _doubts(np.atleast_2d(heights), profile, step=step, resolution=resolution)
    if not fine_enough:
        notes.append(
            f"heights {1e6 * step:.3g} um apart are too coarse for the standard's noise filter of {1e6 * short:.3g} "
            "um: none was used, and figures of other instruments may differ"
        )
    if not long_enough:
        notes.append(f"too short for the standard's cut-off at this Ra; evaluated with {1000 * cutoff:g} mm")
    if len(rows) > 1 and area is None:
        notes.append("too few rows for the areal filter at this cut-off: no Sa, Sq, Sz")
    return HeightReport(profile, area, step, cutoff, (len(rows), rows.shape[1]), tuple(notes))


def measure_area(heights: Heights, *, step: float, cutoff: float) -> ArealRoughness:
    """Compute Sa, Sq and Sz of a levelled map, in m, shape ``(rows, columns)``.

    >>> x = np.arange(0, 4e-3, 10e-6)
    >>> waves = 2e-6 * np.sin(2 * np.pi * x[:, None] / 0.1e-3) * np.sin(2 * np.pi * x / 0.1e-3)
    >>> area = measure_area(waves, step=10e-6, cutoff=0.8e-3)
    >>> round(area.sq * 1e6, 2), round(area.sz * 1e6, 2)
    (1.0, 3.62)
    """
    rough = areal_roughness(heights, step=step, cutoff=cutoff)
    rough = rough - rough.mean()
    return ArealRoughness(float(np.abs(rough).mean()), float(np.sqrt(np.square(rough).mean())), float(np.ptp(rough)))


def areal_roughness(heights: Heights, *, step: float, cutoff: float) -> Heights:
    """Return a map less its Gaussian mean surface, half a cut-off smaller at each edge."""
    half = round(cutoff / 2 / step)
    inner = slice(half, -half or None)
    return np.asarray((heights - _gaussian_mean(heights, step=step, cutoff=cutoff))[inner, inner])


def _gaussian_mean(rows: Heights, *, step: float, cutoff: float) -> Heights:
    """The Gaussian mean surface of a map, or the mean line of one row; the filter is separable."""
    mean = rows.mean()
    smooth = gaussian_line(rows - mean, step=step, cutoff=cutoff)
    if len(rows) > 1:
        smooth = gaussian_line(np.ascontiguousarray(smooth.T), step=step, cutoff=cutoff).T
    return np.asarray(smooth + mean)


def levelled(heights: Heights) -> Heights:
    """Return heights less their least-squares line or plane: the form that ISO takes off before filtering."""
    axes = np.meshgrid(*(np.linspace(-1, 1, size) for size in heights.shape), indexing="ij")
    terms = np.stack([np.ones(heights.size), *(axis.ravel() for axis in axes)], axis=1)
    parts, *_ = np.linalg.lstsq(terms, heights.ravel(), rcond=None)
    return np.asarray(heights - (terms @ parts).reshape(heights.shape))


def read_heights(path: Path, *, unit: str = "m") -> tuple[Heights, float | None]:
    """Read a profile or a height map: heights in m, and the step in m where the file states it.

    The file is ``.npy``; ``.npz`` with an array ``heights``, or with one array alone, and perhaps ``step`` in m;
    ``.csv`` (one column: a profile; more: a map). Its numbers are in ``unit``, one of :data:`UNITS`. Raises
    `DatasetError` if it cannot be read as heights, or holds values that are no numbers.
    """
    if not path.is_file():
        raise DatasetError(f"{path}: no such file; name a height map or profile: .npy, .npz or .csv")
    try:
        if (size := _size(path)) > 8 * MOST_HEIGHTS:
            raise ValueError(
                f"{size / 1e9:.1f} GB of numbers, but at most {8 * MOST_HEIGHTS / 1e9:.2f}; cut or thin it"
            )
        heights, step = _read(path, UNITS[unit])
    except (OSError, ValueError, LookupError, TypeError, ArithmeticError, MemoryError, EOFError, BadZipFile) as error:
        raise DatasetError(f"{path}: cannot be read as heights ({error})") from None
    if heights.ndim not in (1, 2) or heights.size == 0:
        raise DatasetError(f"{path}: heights of shape {heights.shape}; a profile has one axis, a map two")
    if not np.isfinite(heights).all():
        share = float(1 - np.isfinite(heights).mean())
        raise DatasetError(f"{path}: {share:.2%} of its heights are no numbers; fill or cut the gaps first")
    return heights, step


def _size(path: Path) -> int:
    """Return how many bytes the numbers of a file take, by what it says of itself before anything is unpacked."""
    match path.suffix.lower():
        case ".npy":
            return int(np.load(path, mmap_mode="r", allow_pickle=False).nbytes)
        case ".npz":
            with ZipFile(path) as arrays:
                return sum(part.file_size for part in arrays.infolist())
    return path.stat().st_size


def _read(path: Path, scale: float) -> tuple[Heights, float | None]:
    match path.suffix.lower():
        case ".npy":
            return np.asarray(np.load(path, allow_pickle=False), float) * scale, None
        case ".npz":
            with np.load(path, allow_pickle=False) as arrays:
                names = [name for name in arrays.files if name != "step"]
                name = "heights" if "heights" in names else names[0]
                if len(names) > 1 and name != "heights":
                    raise ValueError(f"arrays {', '.join(names)}; name one heights")
                return np.asarray(arrays[name], float) * scale, float(arrays["step"]) if "step" in arrays else None
        case ".csv" | ".txt":
            return _read_csv(path, scale), None
    raise ValueError(f"{path.suffix or 'no suffix'}: only .npy, .npz and .csv are read")


def _read_csv(path: Path, scale: float) -> Heights:
    text = path.read_text(encoding="utf-8-sig").replace(";", ",").replace("\t", ",")
    lines = text.splitlines()
    try:
        float(lines[0].split(",")[0] if lines else "")
    except ValueError:
        lines = lines[1:]  # a heading of words
    if not lines:
        raise ValueError("it holds no numbers")
    rows = np.loadtxt(lines, delimiter=",", ndmin=2)
    if rows.shape[1] == 2:
        raise ValueError("two columns; keep the heights alone, and state their distance with --pixel")
    return (rows[:, 0] if rows.shape[1] == 1 else rows) * scale


def _doubts(rows: Heights, profile: Roughness, *, step: float, resolution: float) -> list[str]:
    doubts = []
    if profile.rdq > STEEPEST:
        doubts.append(f"slopes of {profile.rdq:.3g} on average are no surface's: state the heights' unit with --unit")
    if resolution and profile.ra < resolution:
        doubts.append(
            f"Ra {1e6 * profile.ra:.3g} um is below the sensor's resolution of {1e6 * resolution:g} um: it may be noise"
        )
    levels = np.unique(rows[len(rows) // 2])
    quantum = float(np.diff(levels).min()) if len(levels) > 1 else 0.0
    if len(levels) < 256 and profile.ra < 2 * quantum:
        doubts.append(f"the file's heights are steps of {1e6 * quantum:.3g} um, too coarse for this Ra")
    if profile.rsm < 5 * step:
        doubts.append(
            f"the surface's elements (RSm {1e3 * profile.rsm:.3g} mm) are under five steps of {1e6 * step:.3g} um: "
            "finer ones were not seen, and Ra is too low"
        )
    return doubts
