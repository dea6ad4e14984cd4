"""How does simulated sound differ from real? Prints the second table of the simulator's realism page, draws its figure.

    python benchmarks/realism.py STYLUS PAD REAL [PICTURE]

STYLUS and PAD are sets simulated with these tips, REAL is the folder of the LMT recordings. Compares levels, spectra,
peaks, clicks, flicker and strokes. Enter every run in docs/research/looks.md.
"""

import argparse
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import soundfile
from numpy.typing import NDArray

from tactophone.dataset import Recording, open_dataset
from tactophone.perception.features.resample import Resampler
from tactophone.plotting import BLUE, GREEN, VERMILION, load_pyplot
from tactophone.types import AIR, CONTACT, Touch

WINDOW = 0.032
"""Seconds over which level and crest factor are computed: short against a stroke, long against a grain."""

BAND = (60.0, 7000.0)
"""Hz that are compared: over hum and handling noise, under the real recordings' limit of about 7.5 kHz."""

ACTIVE_DB = 20.0
"""dB under a recording's loudest tenth from which windows are pauses, left out of spectra and crest factors."""

CLICKS_RATE = 16_000
"""Hz."""

TREBLE = 3000.0
"""Hz over which flicker is averaged."""

_OCTAVES = 3
"""Bands an octave."""

_MODULATION = (0.5, 8.0)
"""Hz of strokes."""


@dataclass(frozen=True, slots=True, eq=False)
class Traits:
    """The compared properties of a recording's channel.

    Parameters
    ----------
    level_db
        Of each window, over the recording's mean power.
    spectrum_db
        Power in third-octave bands over that of the whole band, in active windows.
    slope_db
        dB per octave of the line through that spectrum, per hertz.
    crest_db
        Median peak over rms of an active window.
    modulation_db
        Standard deviation of the level at the frequencies of strokes.
    clicks
        Mean log10 of the slope's kurtosis in an active window; 0.48 for Gaussian noise.
    flicker_db
        Standard deviation of each third octave's level from window to window.
    """

    level_db: NDArray[np.float64]
    spectrum_db: NDArray[np.float64]
    slope_db: float
    crest_db: float
    modulation_db: float
    clicks: float
    flicker_db: NDArray[np.float64]


def centres() -> NDArray[np.float64]:
    """Middle frequencies of the third-octave bands, in Hz."""
    count = int(np.log2(BAND[1] / BAND[0]) * _OCTAVES)
    return np.asarray(BAND[0] * 2 ** ((np.arange(count) + 0.5) / _OCTAVES))


def measure_traits(samples: NDArray[np.float64], rate: int) -> Traits:
    """Measure one channel of one recording."""
    size = round(WINDOW * rate)
    windows = samples[: len(samples) // size * size].reshape(-1, size)
    power = np.abs(np.fft.rfft(windows * np.hanning(size), axis=1)) ** 2
    frequency = np.asarray(np.fft.rfftfreq(size, 1 / rate), np.float64)
    power[:, (frequency < BAND[0]) | (frequency > BAND[1])] = 0
    total = power.sum(axis=1) + 1e-20
    level = 10 * np.log10(total / total.mean())
    active = level > np.quantile(level, 0.9) - ACTIVE_DB
    spectrum = _thirds(power[active].mean(axis=0), frequency)
    density = spectrum - 10 * np.log10(centres())
    inner = windows[active] - windows[active].mean(axis=1, keepdims=True)
    crest = 20 * np.log10(np.abs(inner).max(axis=1) / (inner.std(axis=1) + 1e-12))
    return Traits(
        level_db=level,
        spectrum_db=spectrum,
        slope_db=float(np.polyfit(np.log2(centres()), density, 1)[0]),
        crest_db=float(np.median(crest)),
        modulation_db=_modulation(level, size / rate),
        clicks=_clicks(samples, rate, active, size),
        flicker_db=np.array([_thirds(row, frequency, relative=False) for row in power[active]]).std(axis=0),
    )


def _clicks(samples: NDArray[np.float64], rate: int, active: NDArray[np.bool_], size: int) -> float:
    """As the texture detector measures them, at 16 kHz, in the active windows."""
    slower = Resampler(rate, CLICKS_RATE, channels=1).push(samples[:, None].astype(np.float32))[:, 0]
    starts = np.flatnonzero(active) * size * CLICKS_RATE // rate
    window = round(WINDOW * CLICKS_RATE)
    slopes = np.array([np.diff(slower[k : k + window]) for k in starts if k + window <= len(slower)], float)
    return float(np.log10(np.mean(slopes**4, axis=1) / np.mean(slopes**2, axis=1) ** 2).mean())


def measure_recordings(recordings: Iterable[Recording], channel: int) -> dict[str, list[Traits]]:
    """Measure one channel of labelled recordings, by label."""
    traits_by_label: dict[str, list[Traits]] = {"smooth": [], "rough": []}
    for recording in recordings:
        if recording.label in (Touch.SMOOTH, Touch.ROUGH):
            samples, rate = soundfile.read(recording.path, dtype="float64", always_2d=True)
            traits_by_label[recording.known("label")].append(measure_traits(samples[:, channel], rate))
    return traits_by_label


def summary(found: Sequence[Traits]) -> dict[str, float]:
    """Medians over recordings: level's spread (10 to 90 %), slope, crest factor and modulation, all in dB."""
    spread = [float(np.subtract(*np.quantile(traits.level_db, [0.9, 0.1]))) for traits in found]
    return {
        "level spread": float(np.median(spread)),
        "slope per octave": float(np.median([traits.slope_db for traits in found])),
        "crest factor": float(np.median([traits.crest_db for traits in found])),
        "clicks (log10)": float(np.median([traits.clicks for traits in found])),
        "flicker, 3-7 kHz": float(np.median([traits.flicker_db[centres() > TREBLE].mean() for traits in found])),
        "modulation by stroke": float(np.median([traits.modulation_db for traits in found])),
    }


def draw_realism(path: Path, groups: Mapping[str, Mapping[str, Sequence[Traits]]]) -> None:
    """Draw spectra, levels, crest factors and modulation of groups of recordings, by label, as PNG."""
    pyplot = load_pyplot()
    figure, axes = pyplot.subplots(2, 3, figsize=(15, 7.5), layout="constrained")
    for (name, found), colour in zip(groups.items(), (VERMILION, BLUE, GREEN), strict=False):
        for label, style in (("smooth", "--"), ("rough", "-")):
            _draw_group(axes, found[label], color=colour, linestyle=style, label=f"{name}, {label}")
    axes[0, 0].set(xscale="log", xlabel="frequency (Hz)", ylabel="share of power in third octaves (dB)")
    axes[0, 1].set(xlabel="level over the recording's mean (dB)", ylabel="share of windows under it", xlim=(-40, 12))
    axes[1, 0].set(xlabel="crest factor (dB)", ylabel="share of recordings under it")
    axes[1, 1].set(xlabel="modulation of level by strokes (dB)", ylabel="share of recordings under it")
    axes[0, 2].set(xlabel="clicks: log10 of the slope's kurtosis", ylabel="share of recordings under it")
    axes[1, 2].set(xscale="log", xlabel="frequency (Hz)", ylabel="flicker of a third octave's level (dB)")
    for axis in axes.flat:
        axis.grid(alpha=0.3)
    handles, labels = axes[0, 0].get_legend_handles_labels()
    figure.legend(handles, labels, loc="outside upper center", ncols=3, frameon=False)
    figure.savefig(path, dpi=120)
    pyplot.close(figure)


def _draw_group(axes: Any, found: Sequence[Traits], **look: str) -> None:
    axes[0, 0].plot(centres(), np.median([traits.spectrum_db for traits in found], axis=0), **look)
    axes[1, 2].plot(centres(), np.median([traits.flicker_db for traits in found], axis=0), **look)
    for axis, values in (
        (axes[0, 2], np.array([traits.clicks for traits in found])),
        (axes[0, 1], np.concatenate([traits.level_db for traits in found])),
        (axes[1, 0], np.array([traits.crest_db for traits in found])),
        (axes[1, 1], np.array([traits.modulation_db for traits in found])),
    ):
        quantiles = np.linspace(0, 1, 101)
        axis.plot(np.quantile(values, quantiles), quantiles, **look)


def _thirds(
    power: NDArray[np.float64], frequency: NDArray[np.float64], *, relative: bool = True
) -> NDArray[np.float64]:
    edges = BAND[0] * 2 ** (np.arange(len(centres()) + 1) / _OCTAVES)
    # Low bands hold one or two bins: interpolating the running sum shares a bin between its neighbours.
    running = np.interp(edges, frequency, np.cumsum(power))
    return np.asarray(10 * np.log10(np.diff(running) / (power.sum() + 1e-20 if relative else 1.0) + 1e-12))


def _modulation(level_db: NDArray[np.float64], step: float) -> float:
    spectrum = np.fft.rfft(np.maximum(level_db, -40.0) - level_db.mean())
    frequency = np.fft.rfftfreq(level_db.size, step)
    spectrum[(frequency < _MODULATION[0]) | (frequency > _MODULATION[1])] = 0
    return float(np.fft.irfft(spectrum, level_db.size).std())


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("stylus", type=Path)
    parser.add_argument("pad", type=Path)
    parser.add_argument("real", type=Path)
    parser.add_argument("picture", type=Path, nargs="?", default=Path("realism.png"))
    args = parser.parse_args()
    stylus, pad = (open_dataset(folder).recordings for folder in (args.stylus, args.pad))
    real = [recording for recording in open_dataset(args.real).recordings if recording.tier == "core"]
    groups = {
        "real (stylus, air)": measure_recordings(real, CONTACT),  # its only channel
        "simulated stylus, air": measure_recordings(stylus, AIR),
        "simulated pad, air": measure_recordings(pad, AIR),
    }
    rows = {f"{name}, {label}": summary(traits) for name, group in groups.items() for label, traits in group.items()}
    names = next(iter(rows.values()))
    print("| median, dB | " + " | ".join(names) + " |\n|---|" + "--:|" * len(names))
    for name, row in rows.items():
        print(f"| {name} | " + " | ".join(f"{value:.1f}" for value in row.values()) + " |")
    draw_realism(args.picture, groups)
    print(f"\n{args.picture}")


if __name__ == "__main__":
    main()
