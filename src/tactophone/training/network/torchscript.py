"""Reads the models that the paper's authors published: TorchScript archives, in three variants.

Beware: a TorchScript archive is a program. It holds code in TorchScript's own language, which torch runs while
loading, and a pickled part, which torch's own restricted reader opens (never Python's). So import
only files from a source you trust; the ONNX file made of it holds numbers alone, and the live side reads only that.
"""

import warnings
import zipfile
from collections.abc import Iterable
from pathlib import Path

import torch

from tactophone.errors import ModelError
from tactophone.training.network.model import BINS, PaperNetwork, channels_of, weights_of
from tactophone.types import FloatArray

_EXPECTED = (
    "the authors' published TorchScript file (general.pt, fine_tuned.pt or piezo_only.pt), "
    "which their notebook saved with torch.jit"
)


def read_torchscript(path: Path) -> dict[str, FloatArray]:
    """Read the parameters of one of the authors' published models.

    Raises `ModelError` if the file is missing, truncated, a plain pickle, or holds another network.
    """
    _require_torchscript(path)
    try:
        with warnings.catch_warnings():
            # torch calls TorchScript deprecated; the authors' files are as they are.
            warnings.simplefilter("ignore", DeprecationWarning)
            module = torch.jit.load(path, map_location="cpu")  # type: ignore[no-untyped-call]
    except (RuntimeError, ValueError) as error:
        reason = str(error).strip().splitlines()[0]
        raise ModelError(f"{path}: torch cannot load it ({reason}); download it again. Give {_EXPECTED}") from error
    # Only parameters: a resampler's kernel, or another constant, is not a weight.
    found = {name: value.detach().float().numpy().copy() for name, value in module.named_parameters()}
    require_structure(path, found)
    return found


def _require_torchscript(path: Path) -> None:
    if not path.is_file():
        raise ModelError(f"{path}: no such file; give {_EXPECTED}")
    if not zipfile.is_zipfile(path):
        with path.open("rb") as file:
            start = file.read(2)
        # 0x80 opens every pickle of protocol 2 and later.
        kind = "a plain pickle, which could run anything" if start[:1] == b"\x80" else "not a whole TorchScript archive"
        raise ModelError(f"{path}: {kind}; it was not opened. Give {_EXPECTED}")
    with zipfile.ZipFile(path) as archive:
        names, damaged = archive.namelist(), archive.testzip()
    if damaged:
        raise ModelError(f"{path}: damaged, its part {damaged} fails its checksum; download it again")
    if not any("/code/" in name for name in names):
        raise ModelError(
            f"{path}: an archive without TorchScript code, so a pickled state; it was not opened. Give {_EXPECTED}"
        )


def require_structure(path: Path, found: dict[str, FloatArray]) -> None:
    """Raise a ModelError unless parameters are those of the paper's network, for one or two microphones."""
    columns = found["layer1.weight"].shape[-1] if "layer1.weight" in found else 0
    if columns not in (BINS, 2 * BINS):
        raise ModelError(
            f"{path}: layer1 takes {columns or 'nothing, as there is none'}, but the paper's network takes {BINS} "
            f"magnitudes (one microphone) or {2 * BINS} (two); its layers are {_listed(found)}"
        )
    expected = weights_of(PaperNetwork(channels=channels_of(found)))
    wrong = sorted(found.keys() ^ expected.keys())
    wrong += sorted(name for name in found.keys() & expected.keys() if found[name].shape != expected[name].shape)
    if wrong:
        raise ModelError(f"{path}: not the paper's network: {_listed(wrong)} missing, unknown or of another shape")


def _listed(names: Iterable[str]) -> str:
    listed = list(names)
    return ", ".join(listed[:6]) + (", ..." if len(listed) > 6 else "")
