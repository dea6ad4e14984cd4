"""Opens a detector by name or path: the models inside the package, and files of the
user's own."""

from importlib.resources import files
from pathlib import Path

from tactophone.core.errors import ModelError, did_you_mean
from tactophone.core.plugins import DETECTORS, load, registered
from tactophone.core.tips import DEFAULT_TIP, TIPS
from tactophone.core.types import ContactRule, Detector
from tactophone.signal.perception.contact import ContactGate
from tactophone.signal.perception.detector import TouchDetector
from tactophone.signal.perception.fit import FitCheck
from tactophone.signal.perception.model_file import (
    Model,
    ModelCard,
    read_model,
)
from tactophone.signal.perception.no_touch import read_no_touch
from tactophone.signal.perception.noise_floor import SPREAD_DB, NoiseFloor
from tactophone.signal.perception.window_detector import WindowDetector
from tactophone.signal.silences import TOUCH_HOLD

_FOLDER = Path(str(files("tactophone.signal.perception"))) / "models"


def shipped_models() -> list[str]:
    return sorted(path.stem for path in _FOLDER.glob("*.onnx"))


def model_path(name: str) -> Path:
    """Return the path of a model: the name of a shipped one, or a path already.

    Raises `ModelError` if it is neither.
    """
    if name in shipped_models():
        return _FOLDER / f"{name}.onnx"
    if (path := Path(name)).is_file():
        return path
    if name in registered(DETECTORS):
        raise ModelError(
            f"{name} is a detector of another package, but a model file is needed here"
        )
    hint = did_you_mean(name, shipped_models())
    raise ModelError(
        f"no model {name}: give a file, or one of those inside the package: "
        f"{', '.join(shipped_models())}{hint}"
    )


def default_model(tip: str = DEFAULT_TIP) -> str:
    """Return the name of the shipped model for a tip; each works with one channel as
    with two.

    A tip without a model gets that of the default tip: :func:`tip_mismatch` says so.
    """
    return TIPS[tip if tip in TIPS else DEFAULT_TIP].model


def _model_for(tip: str) -> str:
    return TIPS[tip].model if tip in TIPS else tip


def tip_mismatch(card: ModelCard, tip: str) -> str:
    """Return what is wrong with a model for a tip, and what to do; empty if they fit or
    the card names no tip.

    A tip decides the sign of some features: what is rough under one may come out smooth
    under another.
    """
    if not card.tip or card.tip == tip or _model_for(tip) == _model_for(card.tip):
        return ""
    right = (
        f"use --model {TIPS[tip].model}"
        if tip in TIPS
        else "train one on recordings of your finger"
    )
    words = (
        f"the model {card.name} is for the tip {card.tip}, but the tip is {tip}: "
        "smooth and rough may swap"
    )
    return f"{words}; give --tip {card.tip} if that touches, or else {right}"


def open_touch_detector(
    name: str | Model,
    *,
    sample_rate: int,
    contact: ContactRule = "bands",
    follow_floor: bool = False,
) -> TouchDetector:
    """Open a shipped model or a model file with its contact gate, for sound of a rate.

    This is a part of `tactophone.signal.perception.opening.open_detector`, which says
    more: what was given, calibrated or measured, and what to do about broken
    microphones.

    Parameters
    ----------
    name
        As :func:`model_path` takes it; or a model that was read.
    sample_rate
        In Hz.
    contact
        What decides on contact: a gate, by ``bands`` or by its ``level`` alone, within
        milliseconds; or the level of a whole ``window``, as in the paper.
    follow_floor
        Whether the contact gate's threshold begins at the model's own and then follows
        the noise floor; assigning a threshold ends that, and the level decides.

    Raises
    ------
    ModelError
        If there is no such model, or this version cannot run it.
    """
    model = name if isinstance(name, Model) else read_model(model_path(name))
    detector = WindowDetector(model, sample_rate=sample_rate)
    card = detector.card
    if card.kind == "texture":
        detector.fit = FitCheck(
            card.name,
            card.sample_rate,
            tip=card.tip if card.tip_is_simulated else "",
            air=card.microphone == "air",
        )
    detector.no_touch = read_no_touch(model)
    if contact == "window":
        return TouchDetector(detector)
    return _with_gate(
        detector,
        sample_rate=sample_rate,
        follow_floor=follow_floor,
        bands=contact == "bands",
    )


def is_registered(name: str) -> bool:
    """Whether a name is that of another package's detector; models and files go before
    it."""
    if name in shipped_models() or Path(name).is_file():
        return False
    return name in registered(DETECTORS)


def open_registered(name: str, *, sample_rate: int, channels: int) -> Detector:
    """Open the detector that another package has registered under a name."""
    make = load(DETECTORS, name)
    assert make is not None, f"{name} was registered a moment ago"
    detector: Detector = make(sample_rate=sample_rate, channels=channels)
    return detector


def _with_gate(
    detector: WindowDetector,
    *,
    sample_rate: int,
    follow_floor: bool = False,
    bands: bool = True,
) -> TouchDetector:
    """Join a detector and a contact gate of its model's threshold, which begins there
    and may follow the noise."""
    contact = detector.card.gate
    floor = (
        NoiseFloor(contact.threshold_dbfs, spread_db=SPREAD_DB[contact.rule])
        if follow_floor
        else None
    )
    # A hard tip shakes the air microphone too, so there its sound is no sign of speech.
    tip = detector.card.tip or DEFAULT_TIP
    is_soft = tip in TIPS and not TIPS[tip].hard
    hears_air = detector.card.channels > 1
    gate = ContactGate(
        contact.threshold_dbfs,
        sample_rate=sample_rate,
        rule=contact.rule,
        floor=floor,
        hold=TOUCH_HOLD,
        bands=bands and follow_floor,
        pair=bands and follow_floor and hears_air and is_soft,
    )
    return TouchDetector(detector, gate, window=detector.card.duration)
