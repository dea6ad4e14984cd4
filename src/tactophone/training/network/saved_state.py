"""Reads ``model.pt`` of the authors' training notebook: parameters, thresholds and facts of the training.

The notebook saves a dictionary by ``torch.save``. It is opened by torch's restricted reader, which makes numbers, text,
lists and tensors and refuses everything else, so that no code of the file runs.
"""

import math
import pickle
import warnings
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import torch

from tactophone.errors import ModelError
from tactophone.perception import Gate
from tactophone.training.network.settings import NETWORK_RATE, NETWORK_WINDOW_SIZE, REFERENCE_GATE
from tactophone.training.network.torchscript import require_structure
from tactophone.types import LIVE_SAMPLE_RATE, FloatArray

_BUFFER = "resampler."
"""The notebook's network holds its resampler's kernel, which is no parameter."""

_FACTS = (
    "rough_stones", "smooth_stones", "rough_stones_test", "smooth_stones_test", "rough_loudness_mean",
    "smooth_loudness_mean", "training_time",
)  # fmt: skip
"""What the notebook saves besides, kept in the model card."""


@dataclass(frozen=True, slots=True)
class SavedState:
    """What ``model.pt`` holds: parameters, contact gate and facts of the training."""

    weights: dict[str, FloatArray]
    gate: Gate
    facts: dict[str, Any]


def is_saved_state(path: Path) -> bool:
    """Return whether a file is an archive of ``torch.save`` without TorchScript code."""
    if not zipfile.is_zipfile(path):
        return False
    with zipfile.ZipFile(path) as archive:
        names = archive.namelist()
    return any(name.endswith("/data.pkl") for name in names) and not any("/code/" in name for name in names)


def read_saved_state(path: Path) -> SavedState:
    """Read a state that the notebook saved, or a bare state dictionary.

    Raises `ModelError` if the file holds anything but numbers and text, another network, or windows of another length
    or rate.
    """
    try:
        with warnings.catch_warnings():
            warnings.simplefilter("ignore")
            held = torch.load(path, map_location="cpu", weights_only=True)
    except (RuntimeError, pickle.UnpicklingError, EOFError, ValueError) as error:
        reason = str(error).strip().splitlines()[0]
        raise ModelError(
            f"{path}: torch's restricted reader refuses it ({reason}); give the notebook's model.pt or model_script.pt"
        ) from None
    if not isinstance(held, Mapping):
        raise ModelError(f"{path}: holds a {type(held).__name__}, but the notebook saves a dictionary")
    state = held.get("model", held)
    weights = {
        name: value.detach().float().numpy().copy()
        for name, value in state.items()
        if isinstance(value, torch.Tensor) and not name.startswith(_BUFFER)
    }
    require_structure(path, weights)
    _require_windows(path, held)
    facts = {name: held[name] for name in _FACTS if name in held}
    return SavedState(weights, _gate(held), facts)


def _require_windows(path: Path, held: Mapping[str, Any]) -> None:
    """Raise if the parameters are for windows other than the paper's."""
    size, factor = held.get("PART_SIZE", NETWORK_WINDOW_SIZE), held.get("RESAMPLE_FACTOR", _FACTOR)
    if (size, factor) != (NETWORK_WINDOW_SIZE, _FACTOR):
        raise ModelError(
            f"{path}: for windows of {size} samples at 48 kHz / {factor}, but {NETWORK_WINDOW_SIZE} at 48 kHz / "
            f"{_FACTOR} can be run"
        )


_FACTOR = LIVE_SAMPLE_RATE // NETWORK_RATE


def _gate(held: Mapping[str, Any]) -> Gate:
    threshold = held.get("contact_threshold")
    if not isinstance(threshold, float | int) or not 0 < threshold < 1:
        return REFERENCE_GATE
    return Gate(round(20 * math.log10(threshold), 2), "mean_absolute")
