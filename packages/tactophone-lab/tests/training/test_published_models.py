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
from tactophone.signal.perception.model_file import read_model
from tactophone.signal.perception.window_detector import WindowDetector
from tactophone_lab.training.onnx_export import read_weights
from tactophone_lab.training.paper_network import PaperNetwork, magnitudes, weights_of
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


def test_a_networks_state_as_torch_saves_it_is_read(tmp_path: Path) -> None:
    network = PaperNetwork()
    for name, held in (
        ("alone", network.state_dict()),
        ("within", {"model": network.state_dict(), "PART_SIZE": 512}),
        ("as parameters", {"model": dict(network.named_parameters())}),
    ):
        torch.save(held, tmp_path / f"{name}.pt")
        import_published(tmp_path / f"{name}.pt", tmp_path / "imported.onnx")
        read, written = read_weights(tmp_path / "imported.onnx"), weights_of(network)
        assert all(np.array_equal(written[key], read[key]) for key in written)


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


GOOD = PaperNetwork().state_dict()

HOSTILE = {
    "a stride of nothing": {
        "model": {**GOOD, "x": torch.zeros(1).expand(1 << 40)},
    },
    "a weight of stride nothing": {
        "model": {**GOOD, "layer1.bias": torch.zeros(1).expand(256)},
    },
    "at the top": {"y": torch.zeros(1, dtype=torch.float64).expand(1 << 31)},
    "a list": {"model": [1, 2]},
    "a word": {"model": "hello"},
    "sparse": {
        "model": {
            **GOOD,
            "x": torch.sparse_coo_tensor(
                torch.tensor([[0], [0]]), torch.ones(1), (1 << 20, 1 << 20)
            ),
        }
    },
    "without numbers": {"model": {**GOOD, "x": torch.zeros(4, device="meta")}},
    "complex": {
        "model": {**GOOD, "layer1.bias": GOOD["layer1.bias"].to(torch.complex64)}
    },
    "integers": {"model": {**GOOD, "layer1.bias": GOOD["layer1.bias"].to(torch.int64)}},
    "no numbers": {"model": {name: value * np.nan for name, value in GOOD.items()}},
    "infinite": {"model": {**GOOD, "layer1.bias": GOOD["layer1.bias"] + np.inf}},
    "a number as a name": {"model": {**GOOD, 7: torch.zeros(1)}},
    "a tensor as a size": {"model": GOOD, "PART_SIZE": torch.zeros(3)},
    "quantised": {
        "model": {
            **GOOD,
            "x": torch.quantize_per_tensor(torch.zeros(4), 0.1, 0, torch.qint8),
        }
    },
}


@pytest.mark.filterwarnings("ignore::UserWarning", "ignore::DeprecationWarning")
@pytest.mark.parametrize("case", HOSTILE)
def test_hostile_tensors_are_refused_in_one_line_before_they_are_made(
    case: str, tmp_path: Path
) -> None:
    torch.save(HOSTILE[case], tmp_path / "model.pt")
    with pytest.raises(ModelError) as refused:
        import_published(tmp_path / "model.pt", tmp_path / "imported.onnx")
    assert "\n" not in str(refused.value)
    assert not (tmp_path / "imported.onnx").exists()


def test_a_dictionary_within_itself_is_refused(tmp_path: Path) -> None:
    held: dict[str, object] = {}
    held["model"] = held
    torch.save(held, tmp_path / "model.pt")
    with pytest.raises(ModelError, match="without end"):
        import_published(tmp_path / "model.pt", tmp_path / "imported.onnx")


def test_only_short_finite_facts_reach_the_card(tmp_path: Path) -> None:
    notebook(
        tmp_path / "model.pt",
        training_time=torch.zeros(3),
        rough_stones=["A" * 2_000_000],
        smooth_stones=[torch.zeros(2)],
        rough_loudness_mean=float("inf"),
        smooth_loudness_mean=-20.5,
        contact_threshold=float("nan"),
    )
    import_published(tmp_path / "model.pt", tmp_path / "imported.onnx")
    card = read_model(tmp_path / "imported.onnx").card
    assert card.training.keys() == {"source", "smooth_loudness_mean"}


class Writer(nn.Module):
    """TorchScript that writes a file while torch loads it."""

    def __init__(self) -> None:
        super().__init__()
        self.weight = nn.Parameter(torch.zeros(1))

    def forward(self, x: torch.Tensor) -> torch.Tensor:
        return x

    @torch.jit.export
    def __getstate__(self):
        return (self.weight, self.training)

    @torch.jit.export
    def __setstate__(self, state: tuple[torch.Tensor, bool]):
        self.training = state[1]
        written = torch.from_file("victim", True, 8, dtype=torch.uint8)
        written.fill_(80)
        self.weight = state[0]


def test_torchscript_that_writes_files_while_it_is_loaded_writes_none(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    torch.jit.script(Writer()).save(tmp_path / "general.pt")
    with pytest.raises(ModelError):
        import_published(tmp_path / "general.pt", tmp_path / "imported.onnx")
    assert not Path("victim").exists()


def archive_of(path: Path, content: bytes, numbers: bytes = b"") -> Path:
    with zipfile.ZipFile(path, "w") as archive:
        archive.writestr("model/data.pkl", content)
        archive.writestr("model/data/0", numbers)
    return path


NAME_OF_2_TO_THE_60_STEPS = b"\x80\x02})" + 60 * b"2\x86" + b"K\x01s."
NAME_OF_TUPLES_FROM_THE_MEMO = (
    b"\x80\x02})q\x00" + 60 * b"h\x00h\x00\x86q\x00" + b"K\x01s."
)
COPIES_OF_A_LARGE_LIST = (
    b"\x80\x02](" + 10_000 * b"N" + b"eq\x01(ctorch.jit._pickle\nbuild_intlist\nq\x02"
    b"h\x01\x85R" + 2_000 * b"h\x02h\x01\x85R" + b"t."
)
COPIES_OF_A_LARGE_MODULE = (
    b"\x80\x02}("
    + b"".join(b"M" + struct.pack("<H", number) + b"N" for number in range(5_000))
    + b"uq\x01(c__torch__\nModule\nq\x02)\x81h\x01b"
    + 1_500 * b"h\x02)\x81h\x01b"
    + b"t."
)


@pytest.mark.parametrize(
    "content",
    [
        b"\x80\x02r\xff\xff\xff\xff.",
        b"\x80\x04N\x94r\xf0\xff\xff\x7f.",
        b"\x80\x05\x96\xff\xff\xff\xff\xff\x00\x00\x00.",
        b"\x80\x02cposix\nsystem\nX\x04\x00\x00\x00true\x85R.",
        b"\x80\x02X\x01\x00\x00\x00xQ.",
        b"",
        b"(" * 100_000,
        pickle.dumps(Trap(), protocol=2),
        NAME_OF_2_TO_THE_60_STEPS,
        NAME_OF_TUPLES_FROM_THE_MEMO,
        COPIES_OF_A_LARGE_LIST,
        COPIES_OF_A_LARGE_MODULE,
    ],
    ids=range(12),
)
def test_a_pickle_of_anything_else_is_refused_in_one_line(
    content: bytes, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    path = archive_of(tmp_path / "model.pt", content)
    with pytest.raises(ModelError, match="restricted reader") as refused:
        import_published(path, tmp_path / "imported.onnx")
    assert "\n" not in str(refused.value)
    assert not Path("sprung").exists()


def test_names_as_long_as_the_archive_are_refused_before_they_are_joined(
    tmp_path: Path,
) -> None:
    inner = dict.fromkeys(range(5_000))
    torch.save({"A" * 1_000_000: inner}, tmp_path / "model.pt")
    with pytest.raises(ModelError, match="a name without end"):
        import_published(tmp_path / "model.pt", tmp_path / "imported.onnx")
