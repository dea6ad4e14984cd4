"""Opens a detector by name or path: the models that ship inside the package, and files of the user's own."""

from collections.abc import Callable
from importlib.resources import files
from pathlib import Path

from tactophone.errors import ModelError
from tactophone.perception.contact import ContactGate
from tactophone.perception.debounce import ContactDebounce
from tactophone.perception.detector import WindowDetector
from tactophone.perception.features.extractors import EXTRACTORS, SUPPORTS_MISSING_CHANNEL
from tactophone.perception.model_file import Model, read_model
from tactophone.perception.touch_detector import TouchDetector
from tactophone.types import Detector

KINDS: dict[str, Callable[..., Detector]] = dict.fromkeys(EXTRACTORS, WindowDetector)
"""Which detector runs a model of which kind; each is called with the model and ``sample_rate=``."""

SHIPPED = {1: "paper-mono", 2: "paper"}
"""The model for sound of so many channels, where none is named."""

_FOLDER = Path(str(files("tactophone.perception"))) / "models"


def shipped_models() -> list[str]:
    """Names of the models inside the package."""
    return sorted(path.stem for path in _FOLDER.glob("*.onnx"))


def model_path(name: str) -> Path:
    """Where a model lies, by the name of a shipped one or its own path.

    Raises
    ------
    ModelError
        If it is neither.
    """
    if name in shipped_models():
        return _FOLDER / f"{name}.onnx"
    if (path := Path(name)).is_file():
        return path
    raise ModelError(f"no model {name}: give a file, or one of those inside the package: {', '.join(shipped_models())}")


def default_model(channels: int) -> str:
    """Name of the shipped model for sound of so many channels."""
    return SHIPPED[min(channels, 2)]


def spare_model(name: str) -> str | None:
    """Name of the model that goes on for another by the contact microphone alone: itself, if it has learnt to.

    None does for kinds that need both microphones and hear contact by another rule than the paper's.
    """
    card = read_model(model_path(name)).card
    if card.kind in SUPPORTS_MISSING_CHANNEL:
        return name
    return SHIPPED[1] if card.kind == "paper" else None


def open_window_detector(name: str, *, sample_rate: int) -> Detector:
    """Open a shipped model or a model file, for sound of a rate.

    Raises
    ------
    ModelError
        If there is no such model, or this version cannot run it.
    """
    return detector_for(read_model(model_path(name)), sample_rate=sample_rate)


def open_detector(name: str, *, sample_rate: int, fast_contact: bool = True) -> TouchDetector:
    """Open a model with a contact gate of the same threshold beside it; without one if contact shall not be fast.

    Raises
    ------
    ModelError
        If there is no such model, or this version cannot run it.
    """
    model = read_model(model_path(name))
    detector, gate = detector_for(model, sample_rate=sample_rate), model.card.gate
    if not fast_contact:
        return TouchDetector(detector)
    # A banded level tells contact within a short window by itself, and reads far lower than the gate's whole band.
    if gate.rule == "banded":
        return TouchDetector(detector, steady=ContactDebounce())
    return TouchDetector(detector, ContactGate(gate.threshold_dbfs, sample_rate=sample_rate, rule=gate.rule))


def detector_for(model: Model, *, sample_rate: int) -> Detector:
    """Make the detector that a model's kind asks for."""
    if model.card.kind not in KINDS:
        raise ModelError(
            f"model {model.card.name} is of kind {model.card.kind}, but this version runs {', '.join(KINDS)}; "
            "update Tactophone"
        )
    return KINDS[model.card.kind](model, sample_rate=sample_rate)
