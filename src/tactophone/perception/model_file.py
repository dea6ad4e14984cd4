"""Model files: one ONNX file with everything that the live side needs, checked before it runs.

What the network is trained for (rate, window, hop, channels, gate) is stored in the file as a *card*, so that no flag
of the live commands can disagree. docs/reference/model-files.md describes the format.

A file may come from anywhere, so every number and every operator in it has bounds. The file is read as far as needed by
a reader of protocol buffers of a few lines, before ONNX Runtime sees it: already loading a graph computes parts of it.
"""

import hashlib
import json
import math
import re
import threading
import time
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields
from fractions import Fraction
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypeAlias
from weakref import WeakValueDictionary

import msgspec
import numpy as np

from tactophone.errors import ModelError
from tactophone.perception.decision import DecisionRule, Probabilities
from tactophone.perception.levels import LOUDNESS, LoudnessRule
from tactophone.types import FloatArray

if TYPE_CHECKING:
    import onnxruntime


FORMAT_VERSION = 1
CARD_KEY = "tactophone.card"
FEATURES = "features"
LOG_PROBABILITIES = "log_probabilities"
CLASSES = ("none", "smooth", "rough")

_PICKLES = (b"\x80\x02", b"\x80\x03", b"\x80\x04", b"\x80\x05")
_ZIP = b"PK\x03\x04"


Name: TypeAlias = Annotated[str, msgspec.Meta(min_length=1, max_length=200)]


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

    name: Name
    """Shown to people; the file's name may differ."""
    kind: Name
    """Of its features, a key of :data:`tactophone.perception.features.EXTRACTORS`."""
    sample_rate: Annotated[int, msgspec.Meta(ge=2_000, le=192_000)]
    window_size: Annotated[int, msgspec.Meta(ge=1)]
    hop: Fraction
    """`sample_rate`, `window_size` and `hop`: Hz, from the lowest of a detector to the highest of sound cards; samples;
    samples, as a fraction."""
    channels: Annotated[int, msgspec.Meta(ge=1, le=2)]
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
    def duration(self) -> float:
        """Length of a window in s."""
        return self.window_size / self.sample_rate

    @property
    def imported(self) -> bool:
        """Whether another program trained it: ``tactophone model import`` names its source."""
        return "source" in self.training

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
        if len(text) > MAX_CARD:
            raise ValueError(f"a card of {len(text)} characters, but at most {MAX_CARD}")
        try:
            entries = printable(json.loads(text))
        except (RecursionError, OverflowError) as error:
            raise ValueError(f"nested too deep, or a number too large ({error})") from None
        if not isinstance(entries, dict):
            raise ValueError(f"a card of type {type(entries).__name__}, but it is an object with entries")
        if (version := entries.pop("format")) != FORMAT_VERSION:
            raise ValueError(f"format {version}, but this version reads format {FORMAT_VERSION}")
        if (classes := entries.pop("classes")) != list(CLASSES):
            raise ValueError(f"classes {classes}, but they must be {list(CLASSES)}")
        if unknown := entries.keys() - {entry.name for entry in fields(cls)}:
            raise ValueError(f"entries that this version does not know: {', '.join(sorted(unknown))}")
        entries["gate"], entries["decision"] = Gate(**entries["gate"]), DecisionRule(**entries["decision"])
        try:
            card = msgspec.convert(entries, cls, dec_hook=_fraction, from_attributes=True)
        except msgspec.ValidationError as error:
            raise ValueError(error) from None
        longest = round(MAX_DURATION * card.sample_rate)
        if not (card.window_size <= longest and 1 <= card.hop <= longest):
            raise ValueError(f"window_size must be at most {longest} samples, hop from 1 to {longest}")
        return card


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


MAX_CARD = 1_000_000
"""Characters of a card; the shipped ones have a few thousand."""

MAX_BYTES = 200_000_000
"""Of a model file; the paper's network in 32 bits takes 7.5 MB."""

MAX_FEATURES = 100_000
"""Inputs of a network: four hundred times the paper's."""

MAX_DURATION = 10.0
"""Seconds of a window or a hop."""

PROBE_TIMEOUT = 5.0
"""Seconds for all inferences at reading."""

SLOWEST = 0.25
"""Seconds of processor time for one inference; the live system has a hundredth of a second."""

TOO_SLOW = "the model is too slow: {:.2f} s of processor time for a window"

CONTROL_FLOW = frozenset({"Loop", "If", "Scan", "SequenceMap"})
"""Operators that hold graphs of their own: how long they run cannot be known beforehand."""

_FRACTION = re.compile(r"\d{1,9}(/0*[1-9]\d{0,8}|\.\d{1,9})?")

_GRAPH, _FUNCTION, _NODE, _OPERATOR, _ATTRIBUTE = 7, 25, 1, 4, 5
_SUBGRAPHS = {6, 11}
"""Field numbers of ONNX's ModelProto, GraphProto and NodeProto, and those of AttributeProto that hold graphs."""


def check_graph(content: bytes) -> None:
    """Raise `ValueError` for a file with control flow or functions, or one that is no ONNX file."""
    for number, value in _fields(memoryview(content)):
        if number == _FUNCTION:
            raise ValueError("it defines functions of its own")
        if number != _GRAPH or value is None:
            continue
        for inner, node in _fields(value):
            if inner == _NODE and node is not None:
                _check_node(node)


def _check_node(node: memoryview) -> None:
    operators = [bytes(value or b"").decode(errors="replace") for number, value in _fields(node) if number == _OPERATOR]
    if forbidden := CONTROL_FLOW.intersection(operators):
        raise ValueError(f"it has control flow ({', '.join(sorted(forbidden))})")
    for attribute in (value for number, value in _fields(node) if number == _ATTRIBUTE and value is not None):
        # Also the runtime's own operators of this kind, such as searches, whatever their names will be.
        if any(number in _SUBGRAPHS for number, _ in _fields(attribute)):
            raise ValueError(f"an operator with a graph of its own ({', '.join(operators)})")


def _fields(message: memoryview) -> Iterator[tuple[int, memoryview | None]]:
    """Yield the fields of a protocol buffer: number, and content where it has a length."""
    at = 0
    while at < len(message):
        key, at = _varint(message, at)
        match key & 7:
            case 0:
                _, at = _varint(message, at)
                yield key >> 3, None
                continue
            case 1 | 5 as fixed:
                size = 8 if fixed == 1 else 4
            case 2:
                size, at = _varint(message, at)
            case wire:
                raise ValueError(f"wire type {wire} at byte {at}")
        if at + size > len(message):
            raise ValueError(f"{size} bytes announced at byte {at}, but only {len(message) - at} are left")
        yield key >> 3, message[at : at + size] if key & 7 == 2 else None
        at += size


def _varint(message: memoryview, at: int) -> tuple[int, int]:
    value = 0
    for shift in range(0, 70, 7):
        if at >= len(message):
            raise ValueError("it ends within a number")
        byte = message[at]
        value, at = value | (byte & 0x7F) << shift, at + 1
        if byte < 0x80:
            return value, at
    raise ValueError(f"a number of over ten bytes at byte {at}")


def _fraction(kind: type, value: Any) -> Fraction:
    # Checked as text first: the fraction of 1e99999999 would take all memory.
    text = value if isinstance(value, str) else str(value) if type(value) is int else ""
    if not _FRACTION.fullmatch(text):
        raise ValueError("wanted a fraction, such as 64/3")
    return Fraction(text)


def printable(value: Any) -> Any:
    """Replace what a terminal may interpret, such as escape sequences, in all texts of nested entries."""
    match value:
        case str():
            return "".join(
                char if char.isprintable() or char == "\n" else "\N{REPLACEMENT CHARACTER}" for char in value
            )
        case dict():
            return {printable(key): printable(entry) for key, entry in value.items()}
        case list():
            return [printable(entry) for entry in value]
    return value


def check_network(session: "onnxruntime.InferenceSession", *, features: str, output: str, classes: int) -> None:
    """Raise `ValueError` unless the network maps features to one row of classes, within `PROBE_TIMEOUT`."""
    inputs, outputs = session.get_inputs(), session.get_outputs()
    if [(each.name, each.type) for each in inputs] != [(features, "tensor(float)")]:
        raise ValueError(f"its input must be {features}, of floats")
    if [(each.name, each.type) for each in outputs] != [(output, "tensor(float)")]:
        raise ValueError(f"its output must be {output}, of floats")
    shape = inputs[0].shape
    # The number of windows may be a name instead of 1: training and evaluation classify many at once.
    rows, width = shape if len(shape) == 2 else (0, 0)
    if type(width) is not int or not 0 < width <= MAX_FEATURES or (type(rows) is int and rows != 1):
        raise ValueError(f"its input has shape {shape}, but it must be (1, 1 to {MAX_FEATURES})")
    found = _probe(session, features, np.zeros((1, shape[1]), np.float32))
    if found.shape != (1, classes):
        raise ValueError(f"its output has shape {found.shape}, but it must be (1, {classes})")


def _probe(session: "onnxruntime.InferenceSession", features: str, zeros: Any) -> Any:
    """Run the network once, in a thread that is ended when it takes too long."""
    import onnxruntime

    options, results, failures = onnxruntime.RunOptions(), [], []
    options.log_severity_level = 4

    def run() -> None:
        rng = np.random.default_rng(0)
        try:
            # A network may be quick on silence alone, and slow once something is touched.
            for loudness in (0, 1, 1e4):
                noise = zeros + (loudness * rng.standard_normal(zeros.shape)).astype(zeros.dtype)
                begun = time.thread_time()
                results.append(session.run(None, {features: noise}, options)[0])
                if (taken := time.thread_time() - begun) > SLOWEST:
                    failures.append(TOO_SLOW.format(taken))
        except Exception as error:  # ONNX Runtime raises a dozen types of its own
            failures.append(str(error).strip().partition("\n")[0][:160])

    thread = threading.Thread(target=run, daemon=True)
    thread.start()
    thread.join(PROBE_TIMEOUT)
    options.terminate = True
    if thread.is_alive():
        raise ValueError(f"one inference takes over {PROBE_TIMEOUT:g} s")
    if failures:
        raise ValueError(f"its network cannot run ({failures[0]})")
    return results[0]


MOST_ROWS = 3
"""Rows of one call. ONNX Runtime computes four numbers of an array at once, by an exponential whose last bit may differ
from that for the one to three that are left: with four rows, 53 of 60,000 of the stylus' network differed from those of
one row; with up to three, each is what it is alone."""


class Engine:
    """Turns features into probabilities; input and output arrays are allocated once for each number of rows.

    A network whose file names the number of rows instead of stating 1 computes up to `MOST_ROWS` at once, each as it
    would alone, bit for bit. For others, each row is a call.
    """

    def __init__(self, session: "onnxruntime.InferenceSession") -> None:
        rows, width = session.get_inputs()[0].shape
        self.width = int(width)
        """Features that the network takes."""
        self._session, self._most_rows = session, 1 if rows == 1 else MOST_ROWS
        self._bound: dict[int, tuple[onnxruntime.IOBinding, FloatArray, FloatArray]] = {}

    def run(self, features: Sequence[FloatArray]) -> list[Probabilities]:
        """Return the probabilities of none, smooth and rough for each row of features, of shape ``(features,)``.

        A broken network returns NaN, or numbers that do not sum to 1: the caller checks.
        """
        most = self._most_rows
        return [each for at in range(0, len(features), most) for each in self._run(features[at : at + most])]

    def _run(self, features: Sequence[FloatArray]) -> list[Probabilities]:
        binding, rows, log_probabilities = self._bound.get(len(features)) or self._bind(len(features))
        for number, row in enumerate(features):
            rows[number] = row
        begun = time.thread_time()  # which stands still while this thread has to wait
        self._session.run_with_iobinding(binding)
        if (taken := time.thread_time() - begun) > SLOWEST:
            raise ModelError(f"{TOO_SLOW.format(taken)}; choose another with --model")
        # exp of an invalid value far over 0 would overflow; capped at e it still fails the caller's check.
        return [
            (math.exp(min(none, 1.0)), math.exp(min(smooth, 1.0)), math.exp(min(rough, 1.0)))
            for none, smooth, rough in log_probabilities.tolist()
        ]

    def _bind(self, count: int) -> tuple["onnxruntime.IOBinding", FloatArray, FloatArray]:
        # Bound once: naming and wrapping the arrays at every run takes longer than a small network itself.
        binding = self._session.io_binding()
        rows, log_probabilities = np.zeros((count, self.width), np.float32), np.zeros((count, len(CLASSES)), np.float32)
        for bind, name, array in (
            (binding.bind_input, FEATURES, rows),
            (binding.bind_output, LOG_PROBABILITIES, log_probabilities),
        ):
            bind(name, "cpu", 0, np.float32, array.shape, array.ctypes.data)
        self._bound[count] = binding, rows, log_probabilities
        return self._bound[count]
