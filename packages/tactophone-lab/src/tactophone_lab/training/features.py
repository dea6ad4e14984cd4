"""The features of each kind of model, as torch modules that become part of the model's
own graph.

``texture``: sixteen bands, spaced evenly in mel from 40 Hz to 7.6 kHz, as powers on a
log scale, since rough and smooth surfaces differ more up there than under the paper's 1
kHz (docs/research/detector.md); and four values of the newest half of the window's
waveform: its level, its crest (peak over RMS), its clicks (fourth moment of the slope
over the squared second: 3 for Gaussian noise, more for separate impacts) and its
steepness (power of the slope over power). Under a hard tip there is one value more, the
unevenness of the treble: standard deviation over mean of its envelope in steps of a
millisecond. Single strikes of a hard tip ring for a few milliseconds; a smooth
surface's treble is even. `Statistics` turns these values into running statistics of a
touch.

``paper``: the magnitudes of a window's spectrum. They are not normalised (paper,
section III-C): the level of the air microphone relative to the contact microphone
separates rough from smooth. `tactophone_lab.training.onnx_export` writes that graph by
hand, as it writes the network.

``cues``: level, crest and transients are the paper's hand-made classifier (section
III-B: rough is louder and more transient); the median frequency of a microphone's
signal drives the stimulus in Svensson et al. (2021).

Live code runs the exported graph alone (`front`). Training runs the same modules,
exported in two parts (`describe`, `run_statistics`).
"""

import functools
import io
import math
import warnings
from collections.abc import Iterator, Mapping, Sequence
from typing import Any, Literal

import numpy as np
import onnx
import onnxruntime
import torch
from numpy.typing import NDArray
from onnx import numpy_helper
from torch import Tensor, nn

from tactophone.core.texture_bands import (
    BAND_COUNT,
    POWER_FLOOR,
    design_bands,
)
from tactophone.core.types import FloatArray
from tactophone.signal.perception.decision import FORGET_AFTER
from tactophone.signal.perception.model_file import (
    CONTACT_INPUT,
    FEATURES,
    SOUND,
    STATE,
    STATE_OUT,
)
from tactophone_lab.training.onnx_export import IR_VERSION, OPSET
from tactophone_lab.training.recipe_options import (
    BAND_VALUES,
    FEATURE_RATE,
    MIN_VARIANCE,
    SILENT_POWER,
    WINDOWS,
    FeatureKind,
    FeatureSpec,
)

FAINTEST_POWER = 1e-12
"""Power added to a waveform's moments, which cover all bands together."""

TREBLE_FROM = 2000.0
"""Hz: lowest frequency of the treble whose unevenness is measured."""

_TREBLE_TAPS = 33
"""Of its high-pass: 2 ms, short beside a window; it falls from -1 to -30 dB between 2.4
and 1.3 kHz at 16 kHz."""

_ENVELOPE_STEP = 1e-3
"""Seconds of a step of its envelope."""

LEAST_POWER = 1e-14
"""Least power of the treble, so that silence has a finite logarithm."""

LEAST_SHARE = 1e-6
"""Least variance of the treble's power over its squared mean, so that a steady tone has
a finite logarithm."""

_SHAPE_MATRIX = np.array([[1, -0.5, 0, -1], [0, 0, -2, 1], [0, 0, 1, 0], [0, 1, 0, 0]])
"""From the logarithms of four measures (rows: power, the slope's power and fourth
moment, peak) to the four shapes (columns: level, crest, clicks, steepness)."""


def _design_high_pass(sample_rate: int) -> NDArray[np.float64]:
    """Return the taps of a linear-phase high-pass: a windowed sinc (Hamming), of unit
    gain at the highest frequency."""
    place = np.arange(_TREBLE_TAPS) - _TREBLE_TAPS // 2
    cutoff = 2 * TREBLE_FROM / sample_rate
    taps = ((place == 0) - cutoff * np.sinc(cutoff * place)) * np.hamming(_TREBLE_TAPS)
    return np.asarray(taps / abs((taps * (-1.0) ** place).sum()))


class _Module(nn.Module):
    """A module whose constants are given as arrays.

    A node of a graph costs 2 to 3 µs once caches are cold, most of them more than their
    sums. So sizes are integers known beforehand, which need no nodes; only the number
    of windows or fingers is open.
    """

    def __init__(self, **constants: NDArray[Any]) -> None:
        super().__init__()
        for name, value in constants.items():
            self.register_buffer(name, torch.tensor(value))


class Bands(_Module):
    """The power of each channel of windows in the sixteen bands."""

    even: Tensor
    odd: Tensor
    bank: Tensor

    def __init__(self, size: int, sample_rate: int) -> None:
        # The bands are divided by the power of the taper and by the two sides of a
        # real spectrum, so that white noise shows its power per bin at any size.
        # Under 15.2 kHz the highest bands stay empty.
        taper = np.hanning(size + 1)[:-1]
        bank = design_bands(size, sample_rate) / (np.square(taper).sum() * size / 2)
        # The real part of a spectrum depends on x[n] + x[size - n] alone, the imaginary
        # one on x[n] - x[size - n]. So a tapered DFT takes two matrices of a quarter
        # each; the runtime's own transform takes two to three times as long. Sample 0
        # is 0 after the taper; the middle one is its own partner, and would count
        # twice.
        dft = np.fft.rfft(np.diag(taper))[1 : size // 2 + 1]
        dft[-1] /= 2
        heard = np.flatnonzero(bank.any(axis=1))
        matrices = {
            "even": dft.real[:, heard],
            "odd": dft.imag[:, heard],
            "bank": bank[heard],
        }
        super().__init__(
            **{name: matrix.astype(np.float32) for name, matrix in matrices.items()}
        )
        self.middle = size // 2

    def forward(self, sound: Tensor) -> Tensor:
        """Return ``(windows, channels, BAND_COUNT)`` of sound ``(windows, channels,
        samples)``."""
        first = sound[..., 1 : self.middle + 1]
        last = sound[..., self.middle :].flip(-1)
        real = (first + last) @ self.even
        imaginary = (first - last) @ self.odd
        return (real * real + imaginary * imaginary) @ self.bank


class Texture(_Module):
    """Describes windows by the values of kind ``texture``, with or without the
    unevenness of the treble.

    >>> Texture(512, 16_000)(torch.zeros(1, 2, 512)).shape
    torch.Size([1, 2, 20])
    """

    scales: Tensor
    floors: Tensor
    to_values: Tensor
    high_pass: Tensor

    def __init__(
        self, size: int, sample_rate: int, *, unevenness: bool = False
    ) -> None:
        newest = size // 2
        shapes = slice(BAND_COUNT, BAND_VALUES)
        to_values = np.eye(BAND_VALUES + unevenness)
        to_values[shapes, shapes] = _SHAPE_MATRIX
        to_values[BAND_VALUES:] /= 2
        super().__init__(
            scales=np.array(
                [1] * BAND_COUNT + [1 / newest, 1 / (newest - 1), 1 / (newest - 1), 1]
            ),
            floors=np.array(
                [POWER_FLOOR] * BAND_COUNT
                + [
                    FAINTEST_POWER,
                    FAINTEST_POWER,
                    FAINTEST_POWER**2,
                    FAINTEST_POWER**0.5,
                ]
            ),
            to_values=to_values / math.log(10),
            high_pass=_design_high_pass(sample_rate)[None, None].astype(np.float32),
        )
        self.bands = Bands(size, sample_rate)
        self.size, self.step, self.unevenness = (
            size,
            round(_ENVELOPE_STEP * sample_rate),
            unevenness,
        )

    def forward(self, sound: Tensor) -> Tensor:
        """Return log10 of the power in each band, the four shapes, and the unevenness:
        ``(windows, channels, values)``.

        Sound has the shape ``(windows, channels, samples)``.
        """
        newest = sound[..., self.size // 2 :]
        slope = newest[..., 1:] - newest[..., :-1]
        squares = slope * slope
        sums = (
            each.sum(-1, keepdim=True)
            for each in (newest * newest, squares, squares * squares)
        )
        measures = torch.cat(
            (self.bands(sound), *sums, newest.abs().amax(-1, keepdim=True)), -1
        )
        measures = measures.double() * self.scales + self.floors
        if self.unevenness:
            measures = torch.cat((measures, self._unevenness(sound)), -1)
        return torch.log(measures) @ self.to_values

    def _unevenness(self, sound: Tensor) -> Tensor:
        """Return the square of the envelope's deviation over its mean."""
        treble = torch.conv1d(sound.reshape(-1, 1, self.size), self.high_pass)
        steps, rest = divmod(self.size + 1 - _TREBLE_TAPS, self.step)
        pieces = treble[..., rest:].reshape(-1, int(sound.shape[1]), steps, self.step)
        powers = (pieces * pieces).mean(-1).double() + LEAST_POWER
        mean = torch.sqrt(powers).mean(-1, keepdim=True)
        share = powers.mean(-1, keepdim=True) / (mean * mean) - 1
        return share.clamp(min=LEAST_SHARE)


PRIOR_WINDOWS = 3.0
"""Windows that the prior is worth at the start of a touch."""

NEWEST = 3.0
"""Windows by which the newest mean fades: two of 32 ms hardly overlap at this
distance."""

BEFORE = 5
"""Windows by which the running mean precedes the newest mean that it is compared with,
or an edge would be in both."""

STATISTICS_SETTLED = 6
"""Windows that the running mean holds at least before a change can be detected."""


class Statistics(_Module):
    """Running statistics of a touch, restarted where the surface changes; their state
    is an input and an output.

    A window of 32 ms is quick but holds little information; the paper's of 256 ms holds
    more, but also still the last surface. So each short window is described, and the
    exponentially weighted mean and deviation of these descriptions are the features. A
    touch starts with a *prior*, the moments of an average touch, worth a few windows:
    the first prediction is uncertain, and the first evidence changes it at once.

    An edge under a finger that does not lift is a new surface without a new touch, and
    the old one would linger in the statistics. So the newest windows are compared with
    the statistics before them: where they differ more than a finger's changes of speed
    and pressure ever make them differ, the statistics restart with the newest windows.

    Everything is in double precision: a variance is a small difference of large
    numbers. Of the state, see `parts`, all zeros are the state before a touch. What
    training finds are inputs here, and constants in a model file.
    """

    spread: Tensor
    ages: Tensor
    quieter: Tensor
    order: Tensor

    def __init__(self, channels: int, values: int) -> None:
        one = channels * values
        super().__init__(
            spread=np.repeat(np.eye(2), 1 + 2 * one, axis=1),
            ages=np.array([1, 1 + PRIOR_WINDOWS]),
            quieter=np.eye(sum(_sizes(one).values()))[-1],
            order=np.arange(2 * one)
            .reshape(2, channels, values)
            .swapaxes(0, 1)
            .ravel(),
        )
        self.channels = channels
        self.values = values
        self.one = one
        self.entry = 1 + 2 * one

    def forward(
        self,
        description: Tensor,
        contact: Tensor,
        state: Tensor,
        prior: Tensor,
        change_metric: Tensor,
        fading: Tensor,
    ) -> tuple[Tensor, Tensor]:
        """Add a window's description ``(fingers, channels, values)``; without contact
        (0, else 1) it is left out.

        ``prior`` is mean and mean square of the average touch's descriptions, ``(2,
        channels, values)``; for ``change_metric`` see
        :data:`tactophone_lab.training.tracks.ChangeMetric`; ``fading`` is the number
        of windows after which the weight of one has fallen to 1/e.

        Returns the features, ``(fingers, channels * 2 * values)``: for each channel
        means, then deviations; and the state after it.
        """
        touching = contact[:, None] > 0
        added = self._add(
            description.flatten(1).double(),
            touching.double(),
            state,
            change_metric,
            fading,
        )
        # A finger that stays away for long begins a new touch.
        away = torch.where(state[:, -1:] < FORGET_AFTER - 1, state + self.quieter, 0.0)
        after = torch.where(touching, added, away)
        sizes = [self.entry, 1, 2 * self.one, len(self.quieter) - 2 * self.entry]
        _, evidence, running, _ = torch.split(after, sizes, 1)
        mean, square = torch.split(
            running + (1 - evidence) * prior.flatten(), self.one, 1
        )
        deviation = torch.sqrt((square - mean * mean).clamp(min=MIN_VARIANCE))
        features = torch.cat((mean, deviation), 1).float()
        return features[:, self.order] if self.channels > 1 else features, after

    def _add(
        self,
        description: Tensor,
        touching: Tensor,
        state: Tensor,
        change_metric: Tensor,
        fading: Tensor,
    ) -> Tensor:
        """Return the state after a window in contact, where ``touching`` is 1."""
        one = self.one
        entry = self.entry
        sizes = [2 * entry, (BEFORE - 2) * entry, 1, one, one + entry, 1, 1]
        old, _, evidence, before, _, count, quiet = torch.split(state, sizes, 1)
        window = touching, description, description * description
        # A plain average over the first windows, in which the prior counts as
        # PRIOR_WINDOWS; exponential afterwards. Both averages share one count, so a
        # restart leaves the newest one at its least weight.
        least = torch.stack((torch.full_like(fading, 1 / NEWEST), 1 / fading))
        weights = torch.maximum(1 / (count + self.ages), least) @ self.spread
        moved = old + weights * (torch.cat((*window, *window), 1) - old)
        newest, running = torch.split(moved, entry, 1)
        count = count + 1
        shift = newest[:, 1 : 1 + one] - before / evidence
        distance = shift.reshape(-1, self.channels, 1, self.values) @ change_metric
        changed = ((distance * distance).sum((2, 3)).amax(1, keepdim=True) > 1) & (
            count >= BEFORE + STATISTICS_SETTLED
        )
        # Another surface: the newest moments replace the running ones, as if only their
        # windows had been in the touch. The prior counts again as it would after so
        # few, or the first guess would be too certain.
        running = torch.where(
            changed, NEWEST / (NEWEST + PRIOR_WINDOWS) * newest, running
        )
        count = torch.where(changed, NEWEST, count)
        return torch.cat(
            (newest, running, state[:, entry : (1 + BEFORE) * entry], count, 0 * quiet),
            1,
        )


def parts(state: Any, channels: int, values: int) -> dict[str, Any]:
    """Return the named parts of states, each ``(fingers, numbers)``.

    ``newest`` and ``running``: two sets of moments (means, then mean squares) that fade
    side by side, the prior counting as zero. Each follows its evidence, the weight that
    the prior has lost. ``between``: the running ones and their evidence of the last
    windows, newest first, up to those ``before``, `BEFORE` windows ago. ``count``:
    windows since a restart. ``quiet``: windows without contact.
    """
    sizes = _sizes(channels * values)
    ends = np.cumsum(list(sizes.values())).tolist()
    return {
        name: state[:, end - size : end]
        for (name, size), end in zip(sizes.items(), ends, strict=True)
    }


def _sizes(one: int) -> dict[str, int]:
    newest = {"newest evidence": 1, "newest": 2 * one}
    running = {"evidence": 1, "running": 2 * one}
    between = {"between": (BEFORE - 1) * (1 + 2 * one)}
    before = {"evidence before": 1, "before": 2 * one}
    return newest | running | between | before | {"count": 1, "quiet": 1}


def shift_of(state: Mapping[str, Any]) -> Any:
    """Return the newest mean less the running mean before it, ``(fingers, channels *
    values)``."""
    one = state["newest"].shape[1] // 2
    return (
        state["newest"][:, :one] - state["before"][:, :one] / state["evidence before"]
    )


CUES_FROM = 100.0
"""Hz; hum and motors are under it."""

PIECE_DURATION = 0.004
"""Seconds over which a transient's level is measured: a tap on stone rings for about so
long."""

FAINT_POWER = 1e-10
"""Power, -100 dBFS, added to every power: it counts as silence."""


class Cues(_Module):
    """The values :data:`tactophone_lab.training.recipe_options.CUES` of a window; all
    but the last describe the contact channel.

    >>> sine = torch.sin(2 * torch.pi * 500 * torch.arange(4096) / 16_000)[None, None]
    >>> round(float(Cues(4096, 16_000)(sine)[0, 1]), 1)
    3.0
    """

    taper: Tensor
    bins: Tensor
    heard: Tensor

    def __init__(self, size: int, sample_rate: int) -> None:
        bins = np.fft.rfftfreq(size, 1 / sample_rate)
        super().__init__(
            taper=np.hanning(size), bins=bins, heard=(bins >= CUES_FROM).astype(float)
        )
        self.size, self.piece, self.spacing = (
            size,
            round(PIECE_DURATION * sample_rate),
            sample_rate / size,
        )

    def forward(self, sound: Tensor) -> Tensor:
        """Return ``(windows, cues)`` of sound ``(windows, channels, samples)``."""
        squares = sound.double() ** 2
        contact = squares[:, 0]
        power = contact.mean(-1) + FAINT_POWER
        peak = contact.amax(-1) + FAINT_POWER
        air = (
            squares[:, 1].mean(-1) + FAINT_POWER
            if sound.shape[1] > 1
            else power * math.nan
        )
        values = [
            10 * torch.log10(each)
            for each in (power, peak / power, self._transients(contact))
        ]
        centroid, median = (
            torch.log2(each.clamp(min=CUES_FROM))
            for each in self._frequencies(sound[:, 0].double())
        )
        return torch.stack(
            (*values, centroid, median, 10 * torch.log10(air / power)), -1
        ).float()

    def _transients(self, contact: Tensor) -> Tensor:
        """Return the ratio in power between the loudest pieces (one in twenty) and the
        median piece."""
        count = self.size // self.piece
        pieces = (
            contact[:, : count * self.piece].reshape(-1, count, self.piece).mean(-1)
            + FAINT_POWER
        )
        order = torch.topk(pieces, count, largest=False).values
        place = 0.95 * (count - 1)
        below = int(place)
        loud = order[:, below] + (place - below) * (
            order[:, below + 1] - order[:, below]
        )
        return loud / (order[:, (count - 1) // 2] + order[:, count // 2]) * 2

    def _frequencies(self, contact: Tensor) -> tuple[Tensor, Tensor]:
        """Return the centroid of the power spectrum, and the frequency with half of the
        power on either side."""
        size = self.size
        taper = self.taper.double()
        parts = torch.stft(
            contact,
            size,
            size,
            size,
            taper,
            center=False,
            onesided=True,
            return_complex=False,
        )
        powers = (parts * parts).sum(-1)[:, :, 0] * self.heard + FAINT_POWER
        total = powers.cumsum(-1)
        below = (total < total[:, -1:] / 2).double().sum(-1)
        return (powers * self.bins).sum(-1) / total[:, -1], below * self.spacing


class Whole(_Module):
    """All that stands before a texture model's classifier; the features of a channel
    without signal are NaN."""

    columns: Tensor

    def __init__(self, texture: Texture, statistics: Statistics) -> None:
        super().__init__(
            columns=np.repeat(np.arange(statistics.channels), 2 * statistics.values)
        )
        self.texture = texture
        self.statistics = statistics

    def forward(self, sound: Tensor, *others: Tensor) -> tuple[Tensor, Tensor]:
        """Return features ``(fingers, features)`` and state, of sound and what
        `Statistics` takes besides."""
        features, after = self.statistics(self.texture(sound), *others)
        missing = (sound * sound).sum(-1) < SILENT_POWER * self.texture.size
        return torch.where(missing[:, self.columns], math.nan, features), after


CONSTANTS = ("prior", "change_metric", "fading")
"""Inputs of the running statistics that are constants in a model file."""


def front(
    spec: FeatureSpec, constants: Mapping[str, NDArray[np.float64]]
) -> onnx.ModelProto:
    """Return the graph from sound to the features of a specification; kind texture
    brings its `CONSTANTS`."""
    part: Part = "whole" if spec.kind == "texture" else "description"
    graph = onnx.load_from_string(
        _exported(part, spec.kind, spec.channels, spec.unevenness)
    )
    for name, value in constants.items():
        graph.graph.initializer.append(
            numpy_helper.from_array(np.asarray(value, np.float64), name)
        )
        graph.graph.input.remove(
            next(each for each in graph.graph.input if each.name == name)
        )
    return graph


def describe(windows: FloatArray, spec: FeatureSpec) -> NDArray[np.float32]:
    """Describe windows ``(windows, samples, channels)``; of texture ``(windows,
    channels, values)``, else features."""
    session = _session("description", spec.kind, spec.channels, spec.unevenness)
    pieces = [
        windows[at : at + _AT_ONCE].swapaxes(1, 2)
        for at in range(0, max(1, len(windows)), _AT_ONCE)
    ]
    found = [
        session.run(None, {SOUND: np.ascontiguousarray(piece)})[0] for piece in pieces
    ]
    return np.concatenate(found, dtype=np.float32)


def run_statistics(
    descriptions: Sequence[NDArray[np.float32]],
    contact: Sequence[NDArray[np.bool_]],
    change_metric: NDArray[np.float64],
    *,
    fading: float,
) -> Iterator[dict[str, NDArray[np.float64]]]:
    """Run the statistics over whole recordings, several at once; yields the `parts` of
    each one's states.

    A recording's descriptions have the shape ``(windows, channels, values)``.
    """
    channels, values = change_metric.shape[:2]
    session = _session("statistics", "texture", channels, values > BAND_VALUES)
    constants = {
        "prior": np.zeros((2, channels, values)),
        "change_metric": change_metric,
        "fading": np.array(fading),
    }
    for first in range(0, len(descriptions), _TOGETHER):
        together = descriptions[first : first + _TOGETHER]
        touching = contact[first : first + _TOGETHER]
        longest = max(map(len, together))
        # Time first. After a shorter recording's end its state means nothing.
        padded = np.zeros((longest, len(together), channels, values), np.float32)
        gate = np.zeros((longest, len(together)), np.float32)
        for column, (each, loud) in enumerate(zip(together, touching, strict=True)):
            padded[: len(each), column], gate[: len(each), column] = each, loud
        states = np.zeros(
            (longest + 1, len(together), sum(_sizes(channels * values).values()))
        )
        for step in range(longest):
            inputs = {
                DESCRIPTION: padded[step],
                CONTACT_INPUT: gate[step],
                STATE: states[step],
                **constants,
            }
            (states[step + 1],) = session.run([STATE_OUT], inputs)
        for column, each in enumerate(together):
            yield parts(states[1 : len(each) + 1, column], channels, values)


_AT_ONCE = 256
"""Windows that one call of the description takes."""

_TOGETHER = 32
"""Recordings that one call of the statistics takes."""

DESCRIPTION = "description"
Part = Literal["description", "statistics", "whole"]


@functools.lru_cache
def _session(
    part: Part, kind: FeatureKind, channels: int, unevenness: bool
) -> onnxruntime.InferenceSession:
    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = 1
    content = _exported(part, kind, channels, unevenness)
    return onnxruntime.InferenceSession(
        content, options, providers=["CPUExecutionProvider"]
    )


@functools.lru_cache
def _exported(part: Part, kind: FeatureKind, channels: int, unevenness: bool) -> bytes:
    """Return the ONNX file of a part, whose first axis, the number of windows or
    fingers, is open."""
    size, _ = WINDOWS[kind]
    texture = kind == "texture"
    module: nn.Module = (
        Texture(size, FEATURE_RATE, unevenness=unevenness)
        if texture
        else Cues(size, FEATURE_RATE)
    )
    sound = torch.zeros(1, channels, size)
    inputs = {SOUND: sound}
    outputs = [FEATURES]
    if part != "description":
        description = module(sound).float()
        values = description.shape[-1]
        first = {SOUND: sound} if part == "whole" else {DESCRIPTION: description}
        statistics = Statistics(channels, values)
        outputs = [FEATURES, STATE_OUT]
        module = (
            Whole(module, statistics)
            if isinstance(module, Texture) and part == "whole"
            else statistics
        )
        state = torch.zeros(1, len(statistics.quieter)).double()
        constants = (
            torch.zeros(2, channels, values),
            torch.zeros(channels, values, values),
            torch.ones(()),
        )
        inputs = {**first, CONTACT_INPUT: torch.ones(1), STATE: state}
        inputs |= dict(
            zip(CONSTANTS, (each.double() for each in constants), strict=True)
        )
    file: Any = io.BytesIO()
    axes = {
        name: {0: "fingers"} for name in (*inputs, *outputs) if name not in CONSTANTS
    }
    with warnings.catch_warnings():
        # The exporter's own; that the graph computes the same is a test.
        warnings.simplefilter("ignore")
        torch.onnx.export(
            module.eval(),
            tuple(inputs.values()),
            file,
            input_names=list(inputs),
            output_names=outputs,
            dynamic_axes=axes,
            opset_version=OPSET,
            dynamo=False,
        )
    model = onnx.load_from_string(file.getvalue())
    model.ir_version = IR_VERSION
    return bytes(model.SerializeToString())
