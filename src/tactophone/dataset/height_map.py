"""Heights of a surface from a file, and the areal parameters Sa, Sq and Sz (ISO 25178-2).

A map is levelled by its least-squares plane. A Gaussian filter (ISO 16610-61, separable) of a few micrometres takes out
noise where the heights are close enough for it, and one with the cut-off as nesting index takes out waviness. Half a
cut-off at each edge is not evaluated, as with profiles. Ra, Rz and RSm of a map are means over its rows.
"""

from dataclasses import asdict, dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from tactophone.dataset.roughness import Roughness, choose_cutoff, gaussian_line, measure_profile
from tactophone.errors import DatasetError

UNITS = {"m": 1.0, "mm": 1e-3, "um": 1e-6, "nm": 1e-9}
SHORT_CUTOFFS = {0.08e-3: 2.5e-6, 0.25e-3: 2.5e-6, 0.8e-3: 2.5e-6, 2.5e-3: 8e-6, 8e-3: 25e-6}
"""Cut-off of the filter against noise for each cut-off of roughness, in m (ISO 3274, ISO 21920-3)."""

ROWS = 64
"""Most rows that are measured as profiles, evenly drawn: their mean hardly moves with more."""

Heights = NDArray[np.float64]


@dataclass(frozen=True, slots=True)
class ArealRoughness:
    """Areal parameters: mean of the absolute height, its root mean square, and the greatest height, in m."""

    sa: float
    sq: float
    sz: float


STEEPEST = 10.0
"""Slope, rms: 84 degrees. Steeper ones come from heights in another unit than stated."""


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

    def as_json(self) -> dict[str, object]:
        """Return plain numbers, lengths in m."""
        return asdict(self)


def measure_heights(
    heights: Heights, *, step: float, cutoff: float | None = None, resolution: float = 0.0
) -> HeightReport:
    """Measure a profile or a height map.

    Parameters
    ----------
    heights
        In m, shape ``(heights,)`` or ``(rows, columns)``, equally spaced in both directions.
    step
        Between heights, in m.
    cutoff
        Of the filter, in m; by default the one that ISO 21920-3 names for the Ra found.
    resolution
        Height in m under which the sensor shows nothing but noise, if known.

    Raises
    ------
    ValueError
        If there are too few heights for the cut-off.
    """
    rows = np.atleast_2d(levelled(heights))
    long_enough = True
    if cutoff is None:
        cutoff, long_enough = choose_cutoff(rows[len(rows) // 2], step=step)
    short = SHORT_CUTOFFS.get(cutoff, cutoff / 300)
    if fine_enough := 2 * step <= short:
        rows = _without_noise(rows, step=step, cutoff=short)
    drawn = np.unique(np.linspace(0, len(rows) - 1, min(ROWS, len(rows))).round().astype(int))
    found = [measure_profile(rows[row], step=step, cutoff=cutoff) for row in drawn]
    profile = Roughness(*(_mean([getattr(row, name) for row in found]) for name in asdict(found[0])))
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

    Examples
    --------
    >>> x = np.arange(0, 4e-3, 10e-6)
    >>> waves = 2e-6 * np.sin(2 * np.pi * x[:, None] / 0.1e-3) * np.sin(2 * np.pi * x / 0.1e-3)
    >>> area = measure_area(waves, step=10e-6, cutoff=0.8e-3)
    >>> round(area.sq * 1e6, 2), round(area.sz * 1e6, 2)
    (1.0, 3.62)
    """
    rough = areal_roughness(heights, step=step, cutoff=cutoff)
    rough = rough - rough.mean()
    return ArealRoughness(
        float(np.abs(rough).mean()), float(np.sqrt(np.square(rough).mean())), float(rough.max() - rough.min())
    )


def areal_roughness(heights: Heights, *, step: float, cutoff: float) -> Heights:
    """Return a map less its Gaussian mean surface, half a cut-off smaller at each edge."""
    half = round(cutoff / 2 / step)
    middle = heights - heights.mean()
    # Separable: along rows, then along columns.
    along = gaussian_line(middle, step=step, cutoff=cutoff)
    waviness = gaussian_line(np.ascontiguousarray(along.T), step=step, cutoff=cutoff).T
    inner = slice(half, -half or None)
    return np.asarray((middle - waviness)[inner, inner])


def _without_noise(rows: Heights, *, step: float, cutoff: float) -> Heights:
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


def read_heights(path: Path, *, unit: str = "m", height_range: float | None = None) -> tuple[Heights, float | None]:
    """Read a profile or a height map.

    Parameters
    ----------
    path
        ``.npy``; ``.npz`` with an array ``heights``, or with one array alone, and perhaps ``step`` in m; ``.csv``
        (one column: a profile; two: place and height in the same unit; more: a map); ``.png`` in grey.
    unit
        Of the file's numbers: one of :data:`UNITS`. In an image it has no meaning.
    height_range
        Height of white over black in an image, in m.

    Returns
    -------
    tuple
        Heights in m, and the step in m where the file states it.

    Raises
    ------
    DatasetError
        If the file cannot be read as heights, or holds values that are no numbers.
    """
    if not path.is_file():
        raise DatasetError(f"{path}: no such file; name a height map or profile: .npy, .npz, .csv or .png")
    try:
        heights, step = _read(path, UNITS[unit], height_range)
    except (OSError, ValueError, KeyError) as error:
        raise DatasetError(f"{path}: cannot be read as heights ({error})") from None
    if heights.ndim not in (1, 2) or heights.size == 0:
        raise DatasetError(f"{path}: heights of shape {heights.shape}; a profile has one axis, a map two")
    if not np.isfinite(heights).all():
        share = float(1 - np.isfinite(heights).mean())
        raise DatasetError(f"{path}: {share:.2%} of its heights are no numbers; fill or cut the gaps first")
    return heights, step


def _read(path: Path, scale: float, height_range: float | None) -> tuple[Heights, float | None]:
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
            return _read_csv(path, scale)
        case ".png":
            if height_range is None:
                raise ValueError("grey has no unit: give --height-range, the height of white over black")
            return _read_image(path) * height_range, None
    raise ValueError(f"{path.suffix or 'no suffix'}: only .npy, .npz, .csv and .png are read")


def _read_csv(path: Path, scale: float) -> tuple[Heights, float | None]:
    text = path.read_text(encoding="utf-8-sig").replace(";", ",").replace("\t", ",")
    lines = text.splitlines()
    # A first line of words is a heading.
    lines = lines[0 if lines and _is_number(lines[0].split(",")[0]) else 1 :]
    if not lines:
        raise ValueError("it holds no numbers")
    rows = np.loadtxt(lines, delimiter=",", ndmin=2)
    if rows.shape[1] == 1:
        return rows[:, 0] * scale, None
    if rows.shape[1] > 2:
        return rows * scale, None
    steps = np.diff(rows[:, 0])
    if steps.min() <= 0 or np.ptp(steps) > 0.01 * steps.mean():
        raise ValueError("two columns are place and height, and the places are not equally spaced")
    return rows[:, 1] * scale, float(steps.mean() * scale)


def _read_image(path: Path) -> Heights:
    """Read a grey image as heights from 0 to 1; of a colour image, the mean of its colours."""
    from matplotlib import image

    pixels = np.asarray(image.imread(path), float)
    return pixels if pixels.ndim == 2 else np.asarray(pixels[..., :3].mean(axis=2))


def _is_number(text: str) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _mean(values: list[float]) -> float:
    finite = [value for value in values if np.isfinite(value)]
    return float(np.mean(finite)) if finite else float("nan")


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
