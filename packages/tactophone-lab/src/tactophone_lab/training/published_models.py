"""Converts one of the authors' models, published or saved by their training notebook,
into a model file.

They published TorchScript archives in three variants; the notebook saves a dictionary
by ``torch.save``. Both are read by :mod:`~tactophone_lab.training.torch_archive`, which
runs none of their code.
"""

import math
import zipfile
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np

from tactophone.core.errors import ModelError, plain
from tactophone.core.types import LIVE_SAMPLE_RATE, FloatArray
from tactophone.signal.perception.model_file import MAX_BYTES, Gate
from tactophone_lab.training.onnx_export import SPECTRUM_BINS, make_card, write_model
from tactophone_lab.training.paper_network import PaperNetwork, weights_of
from tactophone_lab.training.recipe_options import (
    NETWORK_RATE,
    NETWORK_WINDOW_SIZE,
    REFERENCE_GATE,
)
from tactophone_lab.training.torch_archive import (
    DTYPES,
    StoredTensor,
    TorchArchive,
    UnreadableArchiveError,
    open_archive,
    tensors_of,
)

_EXPECTED = (
    "the authors' published TorchScript file (general.pt, fine_tuned.pt or "
    "piezo_only.pt), or the notebook's model.pt "
    "or model_script.pt"
)

_LICENCE = (
    "see github.com/AIS-Bonn/Roughness_Sensing (code BSD-3-Clause); cite "
    "Pätzold et al., IEEE SMC 2023"
)

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

_LONGEST_FACT = 1_000
"""Characters of a text, or entries of a list, that is kept in the card."""

_FACTOR = LIVE_SAMPLE_RATE // NETWORK_RATE


def import_published(source: Path, target: Path) -> None:
    """Write the ONNX file of a TorchScript model or of the notebook's ``model.pt``,
    weights unrounded.

    The contact gate is the one its authors scored with, or the threshold stored in
    ``model.pt``.
    Raises `ModelError` if the file is missing or damaged, holds anything but numbers
    and text, another network, or one for windows of another length or rate.
    """
    with _open(source) as file:
        archive = open_archive(source, file, wanted=_EXPECTED)
        held = archive.content
        if not isinstance(held, Mapping):
            raise ModelError(
                f"{source}: holds a {type(held).__name__}, but the notebook saves a "
                "dictionary"
            )
        weights = _read_weights(source, archive, held.get("model", held))
    size = held.get("PART_SIZE", NETWORK_WINDOW_SIZE)
    factor = held.get("RESAMPLE_FACTOR", _FACTOR)
    if (size, factor) != (NETWORK_WINDOW_SIZE, _FACTOR):
        raise ModelError(
            f"{source}: for windows of {_short(size)} samples at 48 kHz / "
            f"{_short(factor)}, "
            f"but {NETWORK_WINDOW_SIZE} at 48 kHz / {_FACTOR} can be run"
        )
    threshold = held.get("contact_threshold")
    gate = REFERENCE_GATE
    if isinstance(threshold, float | int) and 0 < threshold < 1:
        gate = Gate(round(20 * math.log10(threshold), 2), "mean_absolute")
    card = make_card(
        weights,
        name=f"authors-{source.stem.replace('_', '-')}",
        gate=gate,
        licence=_LICENCE,
    )
    facts = {name: held[name] for name in _FACTS if _is_fact(held.get(name))}
    facts = {
        "source": f"{source.name}, of the paper's authors or their notebook",
        **facts,
    }
    write_model(target, replace(card, training=facts), weights, storage="float32")


def _open(path: Path) -> zipfile.ZipFile:
    """Open the archive; raises `ModelError` if it is damaged, too large or no
    archive."""
    if not path.is_file():
        raise ModelError(f"{path}: no such file; give {_EXPECTED}")
    if not zipfile.is_zipfile(path):
        raise ModelError(
            f"{path}: not a whole TorchScript archive, or a plain pickle, which could "
            "run anything; it was not opened. "
            f"Give {_EXPECTED}"
        )
    try:
        archive = zipfile.ZipFile(path)
        if sum(part.file_size for part in archive.infolist()) > MAX_BYTES:
            raise ModelError(
                f"{path}: over {MAX_BYTES / 1e6:g} MB once it is unpacked; give "
                f"{_EXPECTED}"
            )
        damaged = archive.testzip()
    except (zipfile.BadZipFile, NotImplementedError, RuntimeError, EOFError) as error:
        raise ModelError(
            f"{path}: not a whole archive ({error}); download it again"
        ) from None
    if damaged:
        raise ModelError(
            f"{path}: damaged, its part {damaged} fails its checksum; download it again"
        )
    return archive


def _read_weights(
    path: Path, archive: TorchArchive, held: Any
) -> dict[str, FloatArray]:
    """Read the parameters of the paper's network, for one or two microphones.

    Names, shapes and types are compared before any number is read. Raises `ModelError`
    where they are another network's.
    """
    try:
        # Only parameters: a resampler's kernel, or another constant, is not a weight.
        found = {
            name: tensor
            for name, tensor in tensors_of(held).items()
            if not name.startswith(_BUFFER)
        }
        _require_structure(path, found)
        weights = {name: archive.read(tensor) for name, tensor in found.items()}
    except UnreadableArchiveError as error:
        raise ModelError(f"{path}: {error}; give {_EXPECTED}") from None
    if bad := [name for name, value in weights.items() if not np.isfinite(value).all()]:
        raise ModelError(
            f"{path}: {bad[0]} holds numbers that are not finite; give {_EXPECTED}"
        )
    return weights


def _require_structure(path: Path, found: Mapping[str, StoredTensor]) -> None:
    """Raise a ModelError unless the parameters fit the paper's network, for one or two
    microphones."""
    shapes = {name: tensor.shape for name, tensor in found.items()}
    one = shapes.get("layer1.weight", ())[-1:] == (SPECTRUM_BINS,)
    expected = weights_of(PaperNetwork(1 if one else 2))

    def fits(name: str) -> bool:
        if name not in found or name not in expected:
            return False
        tensor = found[name]
        readable = tensor.kind in DTYPES and tensor.contiguous
        return readable and tensor.shape == expected[name].shape

    names = sorted(shapes.keys() | expected.keys())
    wrong = [name for name in names if not fits(name)]
    if wrong:
        listed = ", ".join(wrong[:6]) + (", ..." if len(wrong) > 6 else "")
        raise ModelError(
            f"{path}: not the paper's network: {plain(listed)[:400]} missing, unknown "
            "or of another shape or type"
        )


def _is_fact(value: Any) -> bool:
    """Whether a value is a finite number, a short text, or a short list of these."""
    match value:
        case bool() | int():
            return abs(value) < 1 << 53
        case float():
            return math.isfinite(value)
        case str():
            return len(value) <= _LONGEST_FACT
        case list():
            return len(value) <= _LONGEST_FACT and all(
                not isinstance(each, list) and _is_fact(each) for each in value
            )
    return False


def _short(value: Any) -> str:
    return plain(str(value) if isinstance(value, int | float) else type(value).__name__)
