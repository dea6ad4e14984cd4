import pickle
import struct
import zipfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import torch
from torch import nn

from tactophone import AudioBlock
from tactophone.core.errors import ModelError
from tactophone.signal.perception.detector import WindowDetector
from tactophone.signal.perception.model_file import read_model
from tactophone_lab.training.export import read_weights
from tactophone_lab.training.network import PaperNetwork, magnitudes, weights_of
from tactophone_lab.training.published_models import import_published

pytestmark = pytest.mark.filterwarnings("ignore:.*torch.jit.*:DeprecationWarning")


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "channels"), [("general", 2), ("fine_tuned", 2), ("piezo_only", 1)]
)
def test_each_published_variant_predicts_as_before(
    tmp_path: Path, name: str, channels: int
) -> None:
    network = PaperNetwork(channels=channels)
    torch.jit.script(network).save(tmp_path / f"{name}.pt")
    import_published(tmp_path / f"{name}.pt", tmp_path / "imported.onnx")
    model = read_model(tmp_path / "imported.onnx")
    assert model.card.name == f"authors-{name.replace('_', '-')}"
    sound = 0.1 * torch.randn(512, channels).numpy()
    (prediction,) = WindowDetector(model, sample_rate=2000).push(
        AudioBlock(sound, 2000)
    )
    expected = network(magnitudes(torch.from_numpy(sound)[None])).exp()[0].tolist()
    assert prediction.probabilities == pytest.approx(expected, abs=1e-5)


def notebook(path: Path, **changes: object) -> PaperNetwork:
    """Save what the authors' training notebook saves."""
    network = PaperNetwork()
    state = {**network.state_dict(), "resampler.kernel": torch.zeros(1, 1, 301)}
    held = {
        "model": state,
        "RESAMPLE_FACTOR": 24,
        "PART_SIZE": 512,
        "contact_threshold": 0.02,
        "rough_stones": [0, 11],
    }
    torch.save({**held, **changes}, path)
    return network


def test_the_notebooks_state_is_read_with_its_threshold(tmp_path: Path) -> None:
    network = notebook(tmp_path / "model.pt")
    import_published(tmp_path / "model.pt", tmp_path / "imported.onnx")
    model = read_model(tmp_path / "imported.onnx")
    assert model.card.gate.rule == "mean_absolute"
    assert model.card.gate.threshold_dbfs == pytest.approx(-33.98)
    assert model.card.training["rough_stones"] == [0, 11]
    sound = 0.1 * torch.randn(512, 2).numpy()
    (prediction,) = WindowDetector(model, sample_rate=2000).push(
        AudioBlock(sound, 2000)
    )
    expected = network(magnitudes(torch.from_numpy(sound)[None])).exp()[0].tolist()
    assert prediction.probabilities == pytest.approx(expected, abs=1e-5)


class Trap:
    """Runs something while a careless reader unpickles it."""

    def __reduce__(self) -> tuple[object, tuple[str]]:
        return Path.touch, (Path("sprung"),)  # type: ignore[return-value]


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"rough_stones": Trap()}, "restricted reader refuses it"),
        ({"PART_SIZE": 256}, "windows of 256 samples"),
        (
            {"model": {"weight": torch.zeros(3)}},
            r"not the paper's network: layer1\.bias",
        ),
    ],
)
def test_a_state_of_anything_else_is_refused(
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    changes: dict[str, object],
    message: str,
) -> None:
    monkeypatch.chdir(tmp_path)
    notebook(tmp_path / "model.pt", **changes)
    with pytest.raises(ModelError, match=message):
        import_published(tmp_path / "model.pt", tmp_path / "imported.onnx")
    assert not (tmp_path / "sprung").exists()


def published(
    path: Path, *, channels: int = 2, traced: bool = False
) -> dict[str, np.ndarray]:
    """A file of the authors' structure, with other numbers in it."""
    network = PaperNetwork(channels=channels)
    made = (
        torch.jit.trace(network, torch.zeros(1, 257 * channels))
        if traced
        else torch.jit.script(network)
    )
    made.save(path)
    return weights_of(network)


@pytest.mark.slow
@pytest.mark.parametrize("channels", [1, 2])
@pytest.mark.parametrize("traced", [False, True])
def test_every_parameter_is_read(tmp_path: Path, channels: int, traced: bool) -> None:
    written = published(tmp_path / "general.pt", channels=channels, traced=traced)
    import_published(tmp_path / "general.pt", tmp_path / "imported.onnx")
    read = read_weights(tmp_path / "imported.onnx")
    assert written.keys() == read.keys()
    assert all(np.array_equal(written[name], read[name]) for name in written)


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
    "plain pickle": (
        lambda path: path.write_bytes(pickle.dumps(Trap())),
        "a plain pickle",
    ),
    "another network": (
        lambda path: torch.jit.script(nn.Linear(3, 4)).save(path),
        r"not the paper's network: bias",
    ),
    "fewer layers": (renamed, r"not the paper's network: layer_resnet\.4\.bias"),
    "words": (
        lambda path: path.write_text("not a model"),
        "not a whole TorchScript archive",
    ),
}


@pytest.mark.parametrize("fault", REFUSED)
def test_anything_else_is_refused_unopened(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, fault: str
) -> None:
    monkeypatch.chdir(tmp_path)
    make, message = REFUSED[fault]
    make(tmp_path / "general.pt")
    with pytest.raises(ModelError, match=message):
        import_published(tmp_path / "general.pt", tmp_path / "imported.onnx")
    assert not (tmp_path / "sprung").exists()


def test_an_archive_that_grows_is_refused_before_it_is_unpacked(tmp_path: Path) -> None:
    path = tmp_path / "bomb.pt"
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("archive/data.pkl", "x")
    content = bytearray(path.read_bytes())
    struct.pack_into("<I", content, content.index(b"PK\1\2") + 24, 3_000_000_000)
    path.write_bytes(content)
    with pytest.raises(ModelError, match="200 MB once it is unpacked"):
        import_published(path, tmp_path / "model.onnx")
