"""Converts one of the authors' published models into a model file."""

from dataclasses import replace
from pathlib import Path

from tactophone.training.network.export import make_card, write_model
from tactophone.training.network.settings import REFERENCE_GATE
from tactophone.training.network.torchscript import read_torchscript

_LICENCE = "see github.com/AIS-Bonn/Roughness_Sensing (code BSD-3-Clause); cite Pätzold et al., IEEE SMC 2023"


def import_published(source: Path, target: Path) -> None:
    """Write the ONNX file of a published TorchScript model, weights unrounded, gate as in its authors' scoring.

    Raises
    ------
    ModelError
        If the file is not one of theirs; see :func:`tactophone.training.network.torchscript.read_torchscript`.
    """
    weights = read_torchscript(source)
    card = make_card(weights, name=f"authors-{source.stem.replace('_', '-')}", gate=REFERENCE_GATE, licence=_LICENCE)
    facts = {"source": f"{source.name}, published by the paper's authors"}
    write_model(target, replace(card, training=facts), weights, storage="float32")
