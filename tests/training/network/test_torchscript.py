import pickle
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import torch
from torch import nn

from tactophone import ModelError
from tactophone.training.network.model import PaperNetwork, weights_of
from tactophone.training.network.torchscript import read_torchscript

pytestmark = pytest.mark.filterwarnings("ignore:.*torch.jit.*:DeprecationWarning")


def published(path: Path, *, channels: int = 2, traced: bool = False) -> dict[str, np.ndarray]:
    """A file of the authors' structure, with other numbers in it."""
    network = PaperNetwork(channels=channels)
    made = torch.jit.trace(network, torch.zeros(1, 257 * channels)) if traced else torch.jit.script(network)
    made.save(path)
    return weights_of(network)


@pytest.mark.parametrize("channels", [1, 2])
@pytest.mark.parametrize("traced", [False, True])
def test_every_parameter_is_read(tmp_path: Path, channels: int, traced: bool) -> None:
    written = published(tmp_path / "general.pt", channels=channels, traced=traced)
    read = read_torchscript(tmp_path / "general.pt")
    assert written.keys() == read.keys()
    assert all(np.array_equal(written[name], read[name]) for name in written)


class Trap:
    """What a hostile pickle does: run something while it is read."""

    def __reduce__(self) -> tuple[Callable[[str], object], tuple[str]]:
        return Path.touch, (Path("sprung"),)  # type: ignore[return-value]


def truncate(path: Path) -> None:
    published(path)
    path.write_bytes(path.read_bytes()[:100_000])


def damage(path: Path) -> None:
    published(path)
    whole = bytearray(path.read_bytes())
    whole[5000:5100] = bytes(100)
    path.write_bytes(whole)


def renamed(path: Path) -> None:
    network = PaperNetwork()
    network.layer_resnet = nn.ModuleList(nn.Linear(256, 256) for _ in range(4))
    torch.jit.script(network).save(path)


REFUSED: dict[str, tuple[Callable[[Path], object], str]] = {
    "missing": (lambda path: None, "no such file"),
    "truncated": (truncate, "not a whole TorchScript archive"),
    "damaged": (damage, "fails its checksum"),
    "plain pickle": (lambda path: path.write_bytes(pickle.dumps(Trap())), "a plain pickle"),
    "pickled state": (lambda path: torch.save(PaperNetwork().state_dict(), path), "without TorchScript code"),
    "another network": (lambda path: torch.jit.script(nn.Linear(3, 4)).save(path), "its layers are weight, bias"),
    "fewer layers": (renamed, r"not the paper's network: layer_resnet\.4\.bias"),
    "words": (lambda path: path.write_text("not a model"), "not a whole TorchScript archive"),
}


@pytest.mark.parametrize("fault", REFUSED)
def test_anything_else_is_refused_unopened(tmp_path: Path, monkeypatch: pytest.MonkeyPatch, fault: str) -> None:
    monkeypatch.chdir(tmp_path)
    make, message = REFUSED[fault]
    make(tmp_path / "general.pt")
    with pytest.raises(ModelError, match=message):
        read_torchscript(tmp_path / "general.pt")
    assert not (tmp_path / "sprung").exists()
