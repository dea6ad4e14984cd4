"""Converts one of the authors' models, published or saved by their notebook, into a model file."""

from dataclasses import replace
from pathlib import Path

from tactophone.training.network.export import make_card, write_model
from tactophone.training.network.saved_state import SavedState, is_saved_state, read_saved_state
from tactophone.training.network.settings import REFERENCE_GATE
from tactophone.training.network.torchscript import read_torchscript

_LICENCE = "see github.com/AIS-Bonn/Roughness_Sensing (code BSD-3-Clause); cite Pätzold et al., IEEE SMC 2023"


def import_published(source: Path, target: Path) -> None:
    """Write the ONNX file of a TorchScript model or of the notebook's ``model.pt``, weights unrounded.

    The gate is that of its authors' scoring, or the threshold that ``model.pt`` holds. Raises `ModelError` if the file
    is not one of theirs; see :func:`tactophone.training.network.torchscript.read_torchscript` and
    :func:`tactophone.training.network.saved_state.read_saved_state`.
    """
    if is_saved_state(source):
        state = read_saved_state(source)
    else:
        state = SavedState(read_torchscript(source), REFERENCE_GATE, {})
    weights = state.weights
    card = make_card(weights, name=f"authors-{source.stem.replace('_', '-')}", gate=state.gate, licence=_LICENCE)
    facts = {"source": f"{source.name}, of the paper's authors or their notebook", **state.facts}
    write_model(target, replace(card, training=facts), weights, storage="float32")
