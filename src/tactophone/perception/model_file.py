"""Model files: one ONNX file with everything that the live side needs.

What the network is trained for (rate, window, hop, channels, gate) is stored in the file as a *card*, so that no flag
of the live commands can disagree. docs/reference/model-files.md describes the format.
"""

import hashlib
import json
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from fractions import Fraction
from pathlib import Path
from typing import TYPE_CHECKING, Any
from weakref import WeakValueDictionary

from tactophone.errors import ModelError
from tactophone.perception.decision import DecisionRule
from tactophone.perception.features.loudness import LOUDNESS, LoudnessRule
from tactophone.perception.model_checks import MAX_BYTES, check_entries, check_graph, check_network, printable

if TYPE_CHECKING:
    import onnxruntime

FORMAT_VERSION = 1
CARD_KEY = "tactophone.card"
FEATURES = "features"
LOG_PROBABILITIES = "log_probabilities"
CLASSES = ("none", "smooth", "rough")

_PICKLES = (b"\x80\x02", b"\x80\x03", b"\x80\x04", b"\x80\x05")
_ZIP = b"PK\x03\x04"


@dataclass(frozen=True, slots=True)
class Gate:
    """The level of the contact microphone from which there is contact.

    Raises `ValueError` if the rule is unknown or the threshold out of range.
    """

    threshold_dbfs: float
    """Level from which there is contact; "slightly over the noise floor" (paper, section III)."""
    rule: LoudnessRule = "rms"
    """How it is measured: ``rms`` as in the paper, ``mean_absolute`` as in its authors' code, ``banded`` without
    hum."""

    def __post_init__(self) -> None:
        if self.rule not in LOUDNESS or not -200 <= self.threshold_dbfs <= 0:
            raise ValueError(f"{self}: the rule must be one of {', '.join(LOUDNESS)}, the threshold -200 to 0 dBFS")


@dataclass(frozen=True, slots=True)
class ModelCard:
    """Description of a model."""

    name: str
    """Shown to people; the file's name may differ."""
    kind: str
    """Of its features, a key of :data:`tactophone.perception.EXTRACTORS`."""
    sample_rate: int
    window_size: int
    hop: Fraction
    """`sample_rate`, `window_size` and `hop`: Hz; samples; samples, as a fraction."""
    channels: int
    """2 (contact, air) or 1: see ``microphone``."""
    gate: Gate
    decision: DecisionRule = field(default_factory=DecisionRule)
    """`gate` and `decision`: how contact and roughness are decided."""
    settings: Mapping[str, Any] = field(default_factory=dict)
    """Further parameters of a ``kind``."""
    training: Mapping[str, Any] = field(default_factory=dict)
    """Names and hashes of its training sound, the recipe, the seed."""
    scores: Mapping[str, Any] = field(default_factory=dict)
    """Scores on held-out surfaces, with conditions."""
    licence: str = ""
    """Of the weights, and what the licences of the training sound require."""

    @property
    def microphone(self) -> str:
        """The microphone that a model of one channel uses where there are two: ``contact`` or ``air``."""
        return str(self.settings.get("microphone", "contact"))

    @property
    def tip(self) -> str:
        """The tip that the model is for, one of :data:`tactophone.types.TIP_NAMES`; empty where it is unknown.

        A tip decides the sign of some features, so a model is for one tip, or for several of its hardness.
        """
        return str(self.settings.get("tip", ""))

    def to_json(self) -> str:
        """Return the card as it is stored inside a model file."""
        entries = asdict(self) | {"hop": str(self.hop), "classes": CLASSES, "format": FORMAT_VERSION}
        return json.dumps(entries, indent=1)

    @classmethod
    def from_json(cls, text: str) -> "ModelCard":
        """Read a card; raises `ValueError`, `KeyError` or `TypeError` if the text is not a card of this format."""
        try:
            entries = check_entries(json.loads(text))
        except (RecursionError, OverflowError) as error:
            raise ValueError(f"nested too deep, or a number too large ({error})") from None
        if (version := entries.pop("format")) != FORMAT_VERSION:
            raise ValueError(f"format {version}, but this version reads format {FORMAT_VERSION}")
        if (classes := entries.pop("classes")) != list(CLASSES):
            raise ValueError(f"classes {classes}, but they must be {list(CLASSES)}")
        entries["gate"] = Gate(**entries["gate"])
        entries["decision"] = DecisionRule(**entries["decision"])
        return cls(**entries)


@dataclass(frozen=True, slots=True, eq=False, weakref_slot=True)
class Model:
    """A model file that was read: its card, and its network ready to run on one thread."""

    card: ModelCard
    session: "onnxruntime.InferenceSession"


_OPEN_MODELS: WeakValueDictionary[bytes, Model] = WeakValueDictionary()
"""Models in use, by the hash of their file."""


def read_model(path: Path) -> Model:
    """Read a model file; nothing in it is unpickled or run as code.

    Raises
    ------
    ModelError
        If the file is missing or damaged, or is not a Tactophone model.
    """
    try:
        if path.stat().st_size > MAX_BYTES:
            raise ModelError(f"{path}: over {MAX_BYTES / 1e6:g} MB, which no model here takes; give another file")
        content = path.read_bytes()
    except OSError as error:
        raise ModelError(f"{path}: cannot be read ({error.strerror}); give the path of a model file") from None
    if content.startswith((*_PICKLES, _ZIP)):
        raise ModelError(
            f"{path}: a PyTorch or pickle file, which may run code when read and is never opened here; convert the "
            "authors' published models with `tactophone model import`"
        )
    # The fingers of a hand, and a detector and its fallback, share the network of one file: its memory, and its calls.
    digest = hashlib.sha256(content).digest()
    if (model := _OPEN_MODELS.get(digest)) is not None:
        return model
    try:
        check_graph(content)
    except ValueError as error:
        raise ModelError(f"{path}: not a whole ONNX model ({error}); copy or export it again") from None
    # ONNX Runtime computes what is constant while it loads, without any limit of time. So first everything is left to
    # the inference that is checked, and has one; folding its constants then takes no longer than that did.
    session = _session(path, content, without=["ConstantFolding"])
    card = _card(path, session)
    try:
        check_network(session, features=FEATURES, output=LOG_PROBABILITIES, classes=len(CLASSES))
    except ValueError as error:
        raise ModelError(f"{path}: cannot be used ({error}); export it again") from None
    return _OPEN_MODELS.setdefault(digest, Model(card, _session(path, content)))


def _session(path: Path, content: bytes, *, without: Sequence[str] = ()) -> "onnxruntime.InferenceSession":
    import onnxruntime  # here, as it takes longer than all other imports together and `--help` needs none of it

    providers = ["CPUExecutionProvider"]
    try:
        return onnxruntime.InferenceSession(content, _options(), providers=providers, disabled_optimizers=without)
    except Exception as error:  # ONNX Runtime raises a dozen types of its own, all of them about the file
        raise ModelError(f"{path}: not a whole ONNX model ({_first_line(error)}); copy or export it again") from None


def _card(path: Path, session: "onnxruntime.InferenceSession") -> ModelCard:
    try:
        text = session.get_modelmeta().custom_metadata_map.get(CARD_KEY)
    except UnicodeDecodeError:
        raise ModelError(f"{path}: its metadata is not text in UTF-8; export it again") from None
    if text is None:
        raise ModelError(f"{path}: an ONNX model without a Tactophone card; make one with `tactophone train`")
    try:
        return ModelCard.from_json(text)
    except (ValueError, KeyError, TypeError) as error:
        raise ModelError(f"{path}: its card cannot be used ({_first_line(error)}); export it again") from None


def _options() -> "onnxruntime.SessionOptions":
    """One thread, no spinning: the network takes a fraction of a millisecond, and other threads need the processor."""
    import onnxruntime

    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    options.add_session_config_entry("session.intra_op.allow_spinning", "0")
    # Not the runtime's own format, which `check_graph` cannot read and which bytes of both kinds could pass for.
    options.add_session_config_entry("session.load_model_format", "ONNX")
    options.log_severity_level = 3
    return options


def _first_line(error: Exception) -> str:
    return str(printable(str(error).strip().partition("\n")[0][:160]))
