r"""Roughness of measured heights, a profile or a map, by ISO 4287 and ISO 21920-2.

The Gaussian filter (ISO 16610-21) has the weight :math:`s(x) = \exp(-\pi (x /
\alpha\lambda_c)^2) / \alpha\lambda_c` with :math:`\alpha = \sqrt{\ln 2 / \pi}`, so that
half of a wave of the cut-off length passes. The filter passes waviness; the rest is
roughness. Half a cut-off at either end is not evaluated, unless the profile is
periodic.

RSm counts elements between up-crossings of the mean line whose peak and valley both
exceed a tenth of Rz; Rz is the mean over five sampling lengths, or as many as there
are.

A map is levelled by its least-squares plane, and its parameters are means over its
rows. A second Gaussian filter of a few micrometres takes out noise where the heights
are close enough for it.
"""

import math
from dataclasses import asdict, dataclass
from pathlib import Path
from zipfile import ZipFile

import numpy as np
from numpy.typing import NDArray

from tactophone.core.errors import DatasetError
from tactophone.core.extras import require_modules

CUTOFF = 0.8e-3
"""Cut-off of the roughness filter in m: ISO 21920-3's default for an Ra of 0.1 to 2 um,
which is also the scale of a finger pad."""

COARSE_CUTOFF = 2.5e-3
"""Cut-off in m for coarser surfaces: ISO 21920-3's default for an Ra of 2 to 10 um."""

ALPHA = math.sqrt(math.log(2) / math.pi)
"""Width of the Gaussian weight in cut-offs, so that half of a wave of the cut-off
length passes (ISO 16610-21)."""

LEAST_ELEMENT = 0.1
"""Of Rz: the height discrimination of profile elements (ISO 4287, 3.1.6)."""

STANDARD_CUTOFFS = (
    (20e-9, 0.08e-3),
    (100e-9, 0.25e-3),
    (2e-6, 0.8e-3),
    (10e-6, 2.5e-3),
    (80e-6, 8e-3),
)
"""Greatest Ra and its cut-off, in m, of ISO 4288 and ISO 21920-3."""

SLOPE_WEIGHTS = np.array([1.0, -9.0, 45.0, 0.0, -45.0, 9.0, -1.0])
"""Weights of seven neighbours, newest first, in sixtieths of a step."""

UNITS = {"m": 1.0, "mm": 1e-3, "um": 1e-6, "nm": 1e-9}
"""Metres in one of each unit that a file's heights may be written in."""

SHORT_CUTOFFS = {
    0.08e-3: 2.5e-6,
    0.25e-3: 2.5e-6,
    0.8e-3: 2.5e-6,
    2.5e-3: 8e-6,
    8e-3: 25e-6,
}
"""Cut-off of the filter against noise for each cut-off of roughness, in m (ISO 3274,
ISO 21920-3)."""

ROWS = 64
"""Most rows that are measured as profiles, evenly drawn: their mean hardly moves with
more."""

MOST_HEIGHTS = 1 << 25
"""Heights in a file, 5,800 x 5,800; measuring them takes 64 bytes each and more. A
larger map is not read."""

STEEPEST = 10.0
"""Slope, rms: 84 degrees. Steeper ones come from heights in another unit than
stated."""

Heights = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class Roughness:
    """Ra, Rq, Rz and RSm (NaN without profile elements) in m, and Rdq, the RMS slope,
    without unit."""

    ra: float
    rq: float
    rz: float
    rsm: float
    rdq: float


def measure_profile(
    heights: Heights, *, step: float, cutoff: float = CUTOFF, periodic: bool = False
) -> Roughness:
    """Compute the roughness parameters of a profile: heights in m, ``step`` m apart, at
    a filter's cut-off in m.

    A periodic profile has no ends to leave out. Raises `ValueError` if another one is
    shorter than two cut-offs.

    >>> place = np.arange(0, 10e-3, 1e-6)
    >>> sine = measure_profile(5e-6 * np.sin(2 * np.pi * place / 0.1e-3), step=1e-6)
    >>> round(sine.ra * 1e6, 2), round(2 * 5 / math.pi, 2)
    (3.18, 3.18)
    >>> round(sine.rsm * 1e3, 3), round(sine.rdq, 3)
    (0.1, 0.222)
    """
    rough = roughness_profile(heights, step=step, cutoff=cutoff, periodic=periodic)
    rough = rough - rough.mean()
    size = max(1, round(cutoff / step))
    count = max(1, min(5, len(rough) // size))
    lengths = np.array_split(rough[: count * size], count)
    rz = float(np.mean([part.max() - part.min() for part in lengths]))
    rsm = _rsm(rough, LEAST_ELEMENT * rz) * step
    # Each slope is taken over seven heights, as ISO 21920-2 and ISO 4287 define it.
    padded = np.pad(rough, 3, mode="wrap") if periodic else rough
    slopes = np.array([np.nan])
    if len(padded) >= len(SLOPE_WEIGHTS):
        slopes = np.convolve(padded, SLOPE_WEIGHTS, mode="valid") / (60 * step)
    ra = float(np.abs(rough).mean())
    rq = float(np.sqrt(np.square(rough).mean()))
    rdq = float(np.sqrt(np.square(slopes).mean()))
    return Roughness(ra, rq, rz, rsm, rdq)


def roughness_profile(
    heights: Heights, *, step: float, cutoff: float = CUTOFF, periodic: bool = False
) -> Heights:
    """Return heights less the Gaussian mean line, half a cut-off shorter at either end
    unless periodic."""
    if periodic:
        wavenumber = np.fft.rfftfreq(heights.size, step)
        roughness_share = 1 - np.exp(-math.pi * np.square(ALPHA * cutoff * wavenumber))
        return np.asarray(
            np.fft.irfft(np.fft.rfft(heights) * roughness_share, heights.size)
        )
    half = _half_cutoff(len(heights), step=step, cutoff=cutoff)
    middle = heights - heights.mean()
    return np.asarray(
        (middle - gaussian_line(middle, step=step, cutoff=cutoff))[
            half : len(middle) - half
        ]
    )


def _half_cutoff(count: int, *, step: float, cutoff: float) -> int:
    """Return how many heights half a cut-off has; raises `ValueError` if ``count``
    heights are too few for it, or too far apart."""
    length = count * step
    half = round(cutoff / 2 / step) if cutoff <= length else count
    if count < 4 * half or half < 2:
        words = (
            f"a profile of {count} heights {step:g} m apart is too short "
            f"for a cut-off of {cutoff:g} m"
        )
        raise ValueError(
            f"{words}: measure two cut-offs or more, with five heights in each"
        )
    return half


def gaussian_line(heights: Heights, *, step: float, cutoff: float) -> Heights:
    """Return the Gaussian mean line along the last axis of heights of mean zero; near
    the ends it is pulled to 0."""
    half = max(1, round(cutoff / 2 / step))
    place = np.arange(-2 * half, 2 * half + 1) * step / (ALPHA * cutoff)
    weights = np.exp(-math.pi * np.square(place))
    # By FFT: a cut-off may hold a thousand heights.
    size = heights.shape[-1] + len(weights) - 1
    spectrum = np.fft.rfft(heights, size) * np.fft.rfft(weights / weights.sum(), size)
    return np.asarray(
        np.fft.irfft(spectrum, size)[..., 2 * half : 2 * half + heights.shape[-1]]
    )


def choose_cutoff(heights: Heights, *, step: float) -> tuple[float, bool]:
    """Choose a profile's cut-off in m by its own Ra; also whether it was long enough
    for the one that ISO names."""
    fitting = [
        cutoff
        for _, cutoff in STANDARD_CUTOFFS
        if 2 * cutoff <= step * len(heights) and cutoff >= 4 * step
    ]
    if not fitting:
        least = 2 * STANDARD_CUTOFFS[0][1]
        raise ValueError(
            f"{len(heights)} heights {step:g} m apart are under {least:g} m long; "
            "measure a longer line"
        )
    # From the shortest: Ra grows with the cut-off, and the first that agrees with its
    # own Ra is the standard's.
    for cutoff in fitting:
        ra = measure_profile(heights, step=step, cutoff=cutoff).ra
        if _standard_cutoff(ra) <= cutoff:
            return cutoff, True
    return fitting[-1], False


def _standard_cutoff(ra: float) -> float:
    for most, named in STANDARD_CUTOFFS:
        if ra <= most:
            return named
    return STANDARD_CUTOFFS[-1][1]


def _rsm(rough: Heights, least: float) -> float:
    """Mean width of elements, in heights: from one up-crossing to the next, peak and
    valley both high enough."""
    beyond = np.flatnonzero(np.abs(rough) >= least)
    sides = np.sign(rough[beyond])
    # Small wiggles between two excursions on the same side are not crossings.
    ups = np.flatnonzero((sides[:-1] < 0) & (sides[1:] > 0))
    crossings = []
    for low, high in zip(beyond[ups], beyond[ups + 1], strict=True):
        # Where the profile first rises through the mean line between the two, to a
        # fraction of a step.
        part = rough[low : high + 1]
        at = int(np.flatnonzero((part[:-1] < 0) & (part[1:] >= 0))[0])
        crossings.append(low + at + float(part[at] / (part[at] - part[at + 1])))
    return float(np.diff(crossings).mean()) if len(crossings) > 1 else float("nan")


@dataclass(frozen=True, slots=True)
class HeightReport:
    """What was measured, at which step and cut-off in m, in rows and columns, and
    doubts, a sentence each."""

    profile: Roughness
    step: float
    cutoff: float
    shape: tuple[int, int]
    notes: tuple[str, ...]


def measure_heights(
    heights: Heights,
    *,
    step: float,
    cutoff: float | None = None,
    resolution: float = 0.0,
) -> HeightReport:
    """Measure a profile or a height map, shape ``(heights,)`` or ``(rows, columns)``,
    ``step`` apart; all in m.

    The cut-off of the filter is by default the one that ISO 21920-3 names for the Ra
    found. Under ``resolution`` the sensor shows nothing but noise. Raises `ValueError`
    if there are too few heights for the cut-off.
    """
    rows = np.atleast_2d(levelled(heights))
    long_enough = True
    if not cutoff:
        cutoff, long_enough = choose_cutoff(rows[len(rows) // 2], step=step)
    # Before any filter, whose kernel is as long as its cut-off.
    _half_cutoff(rows.shape[1], step=step, cutoff=cutoff)
    places = np.linspace(0, len(rows) - 1, min(ROWS, len(rows))).round().astype(int)
    drawn = rows[np.unique(places)]
    short = SHORT_CUTOFFS.get(cutoff, cutoff / 300)
    fine_enough = 2 * step <= short
    if fine_enough:
        means = drawn.mean(axis=1, keepdims=True)
        drawn = gaussian_line(drawn - means, step=step, cutoff=short) + means
    measured = [measure_profile(row, step=step, cutoff=cutoff) for row in drawn]
    columns = np.array([list(asdict(each).values()) for each in measured]).T
    # A row without profile elements has no RSm: the mean is over rows that have one.
    known = [column[np.isfinite(column)] for column in columns]
    profile = Roughness(
        *(float(values.mean()) if len(values) else math.nan for values in known)
    )
    notes = _doubts(np.atleast_2d(heights), profile, step=step, resolution=resolution)
    if not fine_enough:
        words = (
            f"heights {1e6 * step:.3g} um apart are too coarse for the standard's "
            f"noise filter ({1e6 * short:.3g} um)"
        )
        notes.append(
            f"{words}: none was used, and figures of other instruments may differ"
        )
    if not long_enough:
        notes.append(
            "too short for the standard's cut-off at this Ra; evaluated with "
            f"{1000 * cutoff:g} mm"
        )
    return HeightReport(profile, step, cutoff, (len(rows), rows.shape[1]), tuple(notes))


def levelled(heights: Heights) -> Heights:
    """Return heights less their least-squares line or plane: the form that ISO takes
    off before filtering."""
    axes = np.meshgrid(
        *(np.linspace(-1, 1, size) for size in heights.shape), indexing="ij"
    )
    terms = np.stack([np.ones(heights.size), *(axis.ravel() for axis in axes)], axis=1)
    parts, *_ = np.linalg.lstsq(terms, heights.ravel(), rcond=None)
    return np.asarray(heights - (terms @ parts).reshape(heights.shape))


def read_heights(path: Path, *, unit: str = "m") -> tuple[Heights, float | None]:
    """Read a profile or a height map: heights in m, and the step in m where the file
    states it.

    The file is ``.npy``, ``.npz`` with the array ``heights`` and perhaps ``step`` in m,
    or ``.png`` in shades of grey. Its numbers are in ``unit``, one of :data:`UNITS`.
    Raises `DatasetError` if it holds gaps or no heights.
    """
    if path.suffix.lower() == ".png":
        require_modules("PIL")
    try:
        numbers, step = _read(path)
        heights = np.asarray(numbers, float) * UNITS[unit]
    except Exception as error:  # a library for images raises nearly anything
        raise DatasetError(f"{path}: cannot be read as heights ({error})") from None
    if heights.ndim not in (1, 2) or heights.size == 0:
        raise DatasetError(
            f"{path}: heights of shape {heights.shape}; a profile has one axis, a map "
            "two"
        )
    if not np.isfinite(heights).all():
        raise DatasetError(
            f"{path}: {np.mean(~np.isfinite(heights)):.2%} of its heights are no "
            "numbers; fill the gaps"
        )
    return heights, step


def _read(path: Path) -> tuple[object, float | None]:
    """Return a file's numbers and step; its size is checked by what it says of itself,
    before it is unpacked."""
    kind = path.suffix.lower()
    if kind == ".npy":
        _check_size(np.load(path, mmap_mode="r", allow_pickle=False).nbytes)
        return np.load(path, allow_pickle=False), None
    if kind == ".npz":
        with ZipFile(path) as archive:
            _check_size(sum(part.file_size for part in archive.infolist()))
        with np.load(path, allow_pickle=False) as arrays:
            step = float(arrays["step"]) if "step" in arrays else None
            return arrays["heights"], step
    if kind != ".png":
        raise ValueError(
            "only .npy, .npz and .png are read; save other heights with numpy.save"
        )
    from PIL import Image

    with Image.open(path, formats=("PNG",)) as image:
        _check_size(8 * image.width * image.height)
        if image.mode not in ("L", "I", "I;16", "I;16B"):
            raise ValueError(
                f"its colours are {image.mode}; heights are shades of grey, best of "
                "16 bits"
            )
        return np.array(image), None


def _check_size(size: int) -> None:
    if size > 8 * MOST_HEIGHTS:
        raise ValueError(
            f"{size / 1e9:.1f} GB of numbers, but at most "
            f"{8 * MOST_HEIGHTS / 1e9:.2f}; cut or thin it"
        )


def _doubts(
    rows: Heights, profile: Roughness, *, step: float, resolution: float
) -> list[str]:
    doubts = []
    if profile.rdq > STEEPEST:
        doubts.append(
            f"slopes of {profile.rdq:.3g} on average are no surface's: state the "
            "heights' unit with --unit"
        )
    if resolution and profile.ra < resolution:
        ra = f"Ra {1e6 * profile.ra:.3g} um"
        doubts.append(
            f"{ra} is below the sensor's resolution of {1e6 * resolution:g} um: it "
            "may be noise"
        )
    levels = np.unique(rows[len(rows) // 2])
    if 1 < len(levels) < 256:
        quantum = np.diff(levels).min()
        if profile.ra < 2 * quantum:
            doubts.append(
                f"the file's heights are steps of {1e6 * quantum:.3g} um, too coarse "
                "for this Ra"
            )
    if profile.rsm < 5 * step:
        words = (
            f"the surface's elements (RSm {1e3 * profile.rsm:.3g} mm) are under "
            f"five steps of {1e6 * step:.3g} um"
        )
        doubts.append(f"{words}: finer ones were not seen, and Ra is too low")
    return doubts
