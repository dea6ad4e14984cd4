"""Checkpoints: what a training run needs to continue after a kill, arrays in an npz file, never a pickle."""

import json
import zipfile
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import torch
from torch import nn

from tactophone.errors import ModelError
from tactophone.processes import atomic_write
from tactophone.types import FloatArray


@dataclass(frozen=True, slots=True)
class Checkpoint:
    """The state after ``steps`` batches of the run that ``identity`` describes.

    ``arrays`` holds the network's parameters and the optimiser's moments. Random numbers need no state: each step's
    follow from the seed and the step's number.
    """

    identity: str
    steps: int
    arrays: Mapping[str, FloatArray]


def save(path: Path, checkpoint: Checkpoint) -> None:
    """Write a checkpoint; after a kill the file is the old one or the new one, never half."""
    head = np.array(json.dumps({"identity": checkpoint.identity, "steps": checkpoint.steps}))
    with atomic_write(path) as unfinished, unfinished.open("wb") as file:
        np.savez(file, allow_pickle=False, **{"head": head, **checkpoint.arrays})


def load(path: Path, *, identity: str) -> Checkpoint | None:
    """Read the checkpoint of the run with this identity; ``None`` if there is none yet.

    Raises `ModelError` if the file cannot be read, or belongs to another run.
    """
    if not path.exists():
        return None
    try:
        with np.load(path, allow_pickle=False) as file:
            head = json.loads(str(file["head"]))
            arrays = {name: file[name] for name in file.files if name != "head"}
    except (OSError, EOFError, ValueError, KeyError, zipfile.BadZipFile) as error:
        raise ModelError(f"{path}: not a checkpoint of Tactophone ({error}); delete it to start over") from error
    if head["identity"] != identity:
        raise ModelError(
            f"{path}: left by a run with another recipe, seed or data; delete it to start over, "
            "or repeat the former options to continue"
        )
    return Checkpoint(identity, int(head["steps"]), arrays)


def state_of(network: nn.Module, optimiser: torch.optim.Optimizer) -> dict[str, FloatArray]:
    """Copy what training changes: the parameters, and Adam's two moments of each."""
    arrays = {}
    for name, parameter in network.named_parameters():
        arrays[name] = parameter.detach().numpy().copy()
        for moment in ("exp_avg", "exp_avg_sq"):
            arrays[f"{moment}:{name}"] = optimiser.state[parameter][moment].numpy().copy()
    return arrays


def restore(checkpoint: Checkpoint, network: nn.Module, optimiser: torch.optim.Optimizer) -> None:
    """Restore what :func:`state_of` returned."""
    for name, parameter in network.named_parameters():
        parameter.data.copy_(torch.from_numpy(checkpoint.arrays[name]))
        optimiser.state[parameter] = {
            "step": torch.tensor(float(checkpoint.steps)),
            **{moment: torch.from_numpy(checkpoint.arrays[f"{moment}:{name}"]) for moment in ("exp_avg", "exp_avg_sq")},
        }
