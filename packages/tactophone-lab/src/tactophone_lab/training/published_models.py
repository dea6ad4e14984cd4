"""Converts one of the authors' models, published or saved by their training notebook,
into a model file.

They published TorchScript archives in three variants; the notebook saves a dictionary
by ``torch.save``. A dictionary is opened by torch's restricted reader, which makes
numbers, text, lists and tensors and refuses everything else.

Beware: a TorchScript archive is a program. It holds code in TorchScript's own language,
which torch runs while loading. So import only files from a source you trust; the ONNX
file made of it holds numbers alone, and the live side reads only that.
"""

import math
import pickle
import warnings
import zipfile
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import torch

from tactophone.core.errors import ModelError
from tactophone.core.types import LIVE_SAMPLE_RATE, FloatArray
from tactophone.signal.perception.model_file import MAX_BYTES, Gate
from tactophone_lab.training.export import SPECTRUM_BINS, make_card, write_model
from tactophone_lab.training.network import PaperNetwork, weights_of
from tactophone_lab.training.options import (
    NETWORK_RATE,
    NETWORK_WINDOW_SIZE,
    REFERENCE_GATE,
)

_EXPECTED = (
    "the authors' published TorchScript file (general.pt, fine_tuned.pt or piezo_only.pt), or the notebook's model.pt "
    "or model_script.pt"
)

_LICENCE = "see github.com/AIS-Bonn/Roughness_Sensing (code BSD-3-Clause); cite Pätzold et al., IEEE SMC 2023"

_BUFFER = "resampler."
"""The notebook's network holds its resampler's kernel, which is no parameter."""

_FACTS = (
    "rough_stones",
    "smooth_stones",
    "rough_stones_test",
    "smooth_stones_test",
    "rough_loudness_mean",
    "smooth_loudness_mean",
    "training_time",
)
"""What the notebook saves besides, kept in the model card."""

_FACTOR = LIVE_SAMPLE_RATE // NETWORK_RATE


def import_published(source: Path, target: Path) -> None:
    """Write the ONNX file of a TorchScript model or of the notebook's ``model.pt``,
    weights unrounded.

    The gate is that of its authors' scoring, or the threshold that ``model.pt`` holds.
    Raises `ModelError` if the file is missing or damaged, holds anything but numbers
    and text, another network, or one for windows of another length or rate.
    """
    held = _read(source)
    # Only parameters: a resampler's kernel, or another constant, is not a weight.
    weights = {
        name: value.detach().float().numpy().copy()
        for name, value in held.get("model", held).items()
        if isinstance(value, torch.Tensor) and not name.startswith(_BUFFER)
    }
    _require_structure(source, weights)
    size, factor = (
        held.get("PART_SIZE", NETWORK_WINDOW_SIZE),
        held.get("RESAMPLE_FACTOR", _FACTOR),
    )
    if (size, factor) != (NETWORK_WINDOW_SIZE, _FACTOR):
        raise ModelError(
            f"{source}: for windows of {size} samples at 48 kHz / {factor}, but {NETWORK_WINDOW_SIZE} at 48 kHz / "
            f"{_FACTOR} can be run"
        )
    threshold, gate = held.get("contact_threshold"), REFERENCE_GATE
    if isinstance(threshold, float | int) and 0 < threshold < 1:
        gate = Gate(round(20 * math.log10(threshold), 2), "mean_absolute")
    card = make_card(
        weights,
        name=f"authors-{source.stem.replace('_', '-')}",
        gate=gate,
        licence=_LICENCE,
    )
    facts = {name: held[name] for name in _FACTS if name in held}
    facts = {
        "source": f"{source.name}, of the paper's authors or their notebook",
        **facts,
    }
    write_model(target, replace(card, training=facts), weights, storage="float32")


def _read(path: Path) -> Mapping[str, Any]:
    """Return what the notebook saves: the parameters under ``model``, or alone, and
    perhaps facts of the training."""
    if not path.is_file():
        raise ModelError(f"{path}: no such file; give {_EXPECTED}")
    if not zipfile.is_zipfile(path):
        raise ModelError(
            f"{path}: not a whole TorchScript archive, or a plain pickle, which could run anything; it was not opened. "
            f"Give {_EXPECTED}"
        )
    with zipfile.ZipFile(path) as archive:
        if sum(part.file_size for part in archive.infolist()) > MAX_BYTES:
            raise ModelError(
                f"{path}: over {MAX_BYTES / 1e6:g} MB once it is unpacked; give {_EXPECTED}"
            )
        # torch does not look at the checksums itself.
        names, damaged = archive.namelist(), archive.testzip()
    if damaged:
        raise ModelError(
            f"{path}: damaged, its part {damaged} fails its checksum; download it again"
        )
    try:
        with warnings.catch_warnings():
            # torch calls TorchScript deprecated; the authors' files are as they are.
            warnings.simplefilter("ignore")
            if any("/code/" in name for name in names):
                module = torch.jit.load(path, map_location="cpu")  # type: ignore[no-untyped-call]
                return {"model": dict(module.named_parameters())}
            held = torch.load(path, map_location="cpu", weights_only=True)
    except (RuntimeError, pickle.UnpicklingError, EOFError, ValueError) as error:
        reason = str(error).strip().splitlines()[0]
        raise ModelError(
            f"{path}: torch's restricted reader refuses it ({reason}); give {_EXPECTED}"
        ) from None
    if not isinstance(held, Mapping):
        raise ModelError(
            f"{path}: holds a {type(held).__name__}, but the notebook saves a dictionary"
        )
    return held


def _require_structure(path: Path, found: Mapping[str, FloatArray]) -> None:
    """Raise a ModelError unless parameters are those of the paper's network, for one or
    two microphones."""
    shapes = {name: value.shape for name, value in found.items()}
    expected = weights_of(
        PaperNetwork(
            1 if shapes.get("layer1.weight", ())[-1:] == (SPECTRUM_BINS,) else 2
        )
    )
    names = sorted(shapes.keys() | expected.keys())
    wrong = [
        name
        for name in names
        if shapes.get(name) != getattr(expected.get(name), "shape", None)
    ]
    if wrong:
        listed = ", ".join(wrong[:6]) + (", ..." if len(wrong) > 6 else "")
        raise ModelError(
            f"{path}: not the paper's network: {listed} missing, unknown or of another shape"
        )
