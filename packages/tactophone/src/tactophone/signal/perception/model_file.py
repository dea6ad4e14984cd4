"""Model files: one ONNX file with everything that the live side needs, checked before
it runs.

The graph goes from sound to probabilities: it holds the features too, and what it
remembers of a touch is an input and an output. What the network is trained for (rate,
window, hop, channels, gate) is stored in the file as a *card*, so that no flag of the
live commands can disagree. docs/reference/model-files.md describes the format.

A file may come from anywhere, so every number and every operator in it has bounds. Its
table of contents is checked before ONNX Runtime sees it (`onnx_table`), because even
loading a graph computes parts of it. A file that this package does not ship is then
tried in a process with limits of memory and time (`model_trial`).
"""

import hashlib
import json
import math
import re
import threading
import time
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field, fields
from fractions import Fraction
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, TypeAlias, TypeVar
from weakref import WeakValueDictionary

import msgspec
import numpy as np
from numpy.typing import NDArray

from tactophone.core.errors import ModelError, plain
from tactophone.core.microphones import AIR, CONTACT, MICROPHONES
from tactophone.core.types import FloatArray, Touch
from tactophone.signal.perception.decision import DecisionRule, Probabilities
from tactophone.signal.perception.levels import LOUDNESS, LoudnessRule
from tactophone.signal.perception.model_trial import shipped_digests, try_in_child
from tactophone.signal.perception.onnx_table import check_graph

if TYPE_CHECKING:
    import onnxruntime


FORMAT_VERSION = 2
CARD_KEY = "tactophone.card"

SOUND = "sound"
"""Input: a window of each finger, ``(fingers, channels, samples)``."""

CONTACT_INPUT = "contact"
"""Input of graphs that remember a touch: whether the finger touches, 0 or 1,
``(fingers,)``."""

STATE = "state"
"""Input of such graphs: what they remember, in double precision, ``(fingers, size)``;
zeros at the start."""

LOG_PROBABILITIES = "log_probabilities"
"""Output: of none, smooth and rough, ``(fingers, 3)``."""

FEATURES = "features"
"""Output: what the classifier takes, ``(fingers, features)``."""

STATE_OUT = "state_out"
"""Output of graphs that remember a touch: the state for the next window."""

KINDS = ("paper", "texture", "cues")
"""Of features: see :mod:`tactophone_lab.training.features`."""

SUPPORTS_MISSING_CHANNEL = frozenset({"texture", "cues"})
"""Kinds that can do without the air microphone."""

CLASSES = tuple(touch.name.lower() for touch in Touch)

_PICKLES = (b"\x80\x02", b"\x80\x03", b"\x80\x04", b"\x80\x05")
_ZIP = b"PK\x03\x04"


Name: TypeAlias = Annotated[str, msgspec.Meta(min_length=1, max_length=200)]


@dataclass(frozen=True, slots=True)
class Gate:
    """The level of the contact microphone from which there is contact.

    Raises `ValueError` if the rule is unknown or the threshold out of range.
    """

    threshold_dbfs: float
    """Level from which there is contact; the paper's "slightly exceeds" the noise floor
    (section III-C)."""
    rule: LoudnessRule = "rms"
    """How it is measured: ``rms`` as in the paper, ``mean_absolute`` as in its authors'
    code, ``banded`` without hum."""

    def __post_init__(self) -> None:
        if self.rule not in LOUDNESS or not -200 <= self.threshold_dbfs <= 0:
            raise ValueError(
                f"{self}: the rule must be one of {', '.join(LOUDNESS)}, the "
                "threshold -200 to 0 dBFS"
            )


T = TypeVar("T")

Samples = TypeVar("Samples", FloatArray, NDArray[np.bool_])
"""Sound, or the mask of its invalid samples."""


@dataclass(frozen=True, slots=True)
class ModelCard:
    """Description of a model."""

    name: Name
    """Shown to people; the file's name may differ."""
    kind: Name
    """Of its features, one of :data:`KINDS`."""
    sample_rate: Annotated[int, msgspec.Meta(ge=2_000, le=192_000)]
    window_size: Annotated[int, msgspec.Meta(ge=1)]
    hop: Fraction
    """`sample_rate`, `window_size` and `hop`: Hz, from the lowest of a detector to the
    highest of sound cards; samples; samples, as a fraction."""
    channels: Annotated[int, msgspec.Meta(ge=1, le=len(MICROPHONES))]
    """2 (contact, air) or 1: see ``microphone``."""
    gate: Gate
    decision: DecisionRule = field(default_factory=DecisionRule)
    """`gate` and `decision`: how contact and roughness are decided of single windows;
    with the contact gate, `decision` gives the evidence its reference."""
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
        """The microphone that a model of one channel uses where there are two:
        ``contact`` or ``air``."""
        return str(self.settings.get("microphone", "contact"))

    def heard(self, samples: Samples) -> Samples:
        """Return the channels that the model uses of sound, ``(samples, channels)``,
        which may have more."""
        return samples[:, self.channels_heard(samples.shape[1])]

    def channels_heard(self, channels: int) -> slice:
        """Return which channels the model uses of sound that has so many."""
        more = channels > self.channels
        first = AIR if more and self.microphone == "air" else CONTACT
        return slice(first, first + self.channels)

    @property
    def duration(self) -> float:
        """Length of a window in s."""
        return self.window_size / self.sample_rate

    @property
    def imported(self) -> bool:
        """Whether another program trained it: ``tactophone import-model`` names its
        source."""
        return "source" in self.training

    @property
    def tip(self) -> str:
        """The tip that the model is for, one of :data:`tactophone.core.tips.TIP_NAMES`;
        empty where it is unknown.

        A tip decides the sign of some features, so a model is for one tip, or for
        several of its hardness.
        """
        return str(self.settings.get("tip", ""))

    @property
    def tip_is_simulated(self) -> bool:
        """Whether the model learnt its tip from the simulator, so that what it hears
        can be compared with simulated touch (`signal.perception.fit`).

        A user's own finger need not sound like the simulated one of its tip.
        """
        return self.settings.get("tip_sound") == "simulated"

    def to_json(self) -> str:
        entries = asdict(self) | {
            "hop": str(self.hop),
            "classes": CLASSES,
            "format": FORMAT_VERSION,
        }
        return json.dumps(entries, indent=1)

    @classmethod
    def from_json(cls, text: str) -> "ModelCard":
        """Read a card; raises `ValueError`, `KeyError` or `TypeError` if the text is
        not a card of this format."""
        if len(text) > MAX_CARD:
            raise ValueError(
                f"a card of {len(text)} characters, but at most {MAX_CARD}"
            )
        try:
            entries = printable(json.loads(text))
        except (RecursionError, OverflowError) as error:
            raise ValueError(
                f"nested too deep, or a number too large ({error})"
            ) from None
        if not isinstance(entries, dict):
            raise ValueError(
                f"a card of type {type(entries).__name__}, but it is an object with "
                "entries"
            )
        if (version := entries.pop("format")) != FORMAT_VERSION:
            raise ValueError(
                f"format {version}, but this version reads format {FORMAT_VERSION}"
            )
        if (classes := entries.pop("classes")) != list(CLASSES):
            raise ValueError(f"classes {classes}, but they must be {list(CLASSES)}")
        if unknown := entries.keys() - {entry.name for entry in fields(cls)}:
            raise ValueError(
                f"entries that this version does not know: {', '.join(sorted(unknown))}"
            )
        try:
            entries["gate"] = _converted(entries["gate"], Gate)
            entries["decision"] = _converted(entries["decision"], DecisionRule)
            card = msgspec.convert(
                entries, cls, dec_hook=_fraction, from_attributes=True
            )
        except msgspec.ValidationError as error:
            raise ValueError(error) from None
        longest = round(MAX_DURATION * card.sample_rate)
        if not (card.window_size <= longest and 1 <= card.hop <= longest):
            raise ValueError(
                f"window_size must be at most {longest} samples, hop from 1 to "
                f"{longest}"
            )
        return card


def _converted(entries: dict[str, Any], kind: type[T]) -> T:
    """Return a part of a card, with its types checked; raises `TypeError` for entries
    that it does not have."""
    kind(**entries)
    return msgspec.convert(entries, kind)


@dataclass(frozen=True, slots=True, eq=False, weakref_slot=True)
class Model:
    """A model file that was read: its card, and its network ready to run on one
    thread."""

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
            raise ModelError(
                f"{path}: over {MAX_BYTES / 1e6:g} MB, which no model here takes; "
                "give another file"
            )
        content = path.read_bytes()
    except OSError as error:
        raise ModelError(
            f"{path}: cannot be read ({error.strerror}); give the path of a model file"
        ) from None
    if content.startswith((*_PICKLES, _ZIP)):
        raise ModelError(
            f"{path}: a PyTorch or pickle file, which may run code when read and is "
            "never opened here; convert the "
            "authors' published models with `tactophone import-model`"
        )
    # The fingers of a hand, and a detector and its fallback, share the network of one
    # file: its memory, and its calls.
    digest = hashlib.sha256(content).digest()
    if (model := _OPEN_MODELS.get(digest)) is not None:
        return model
    try:
        check_graph(content)
    except ValueError as error:
        raise ModelError(
            f"{path}: not a whole ONNX model ({error}); copy or export it again"
        ) from None
    if digest not in shipped_digests():
        try_in_child(path, content)
    return _OPEN_MODELS.setdefault(digest, load_model(path, content))


def load_model(path: Path, content: bytes) -> Model:
    """Load a model whose file is harmless: one that was shipped or tried; ``path`` is
    for messages."""
    session = _session(path, content)
    return Model(_card(path, session), session)


def probe_model(path: Path, content: bytes) -> None:
    """Load a model and run it on noise; raises `ModelError` where it cannot be used.

    Loading may take any memory and time: `try_in_child` calls this where both have
    limits.
    """
    # ONNX Runtime computes what is constant while it loads, without any limit of time.
    # So first everything is left to the inference that is checked, and has one; folding
    # its constants then takes no longer than that did.
    session = _session(path, content, without=["ConstantFolding"])
    card = _card(path, session)
    try:
        check_network(session, card)
    except ValueError as error:
        raise ModelError(f"{path}: cannot be used ({error}); export it again") from None
    load_model(path, content)


def _session(
    path: Path, content: bytes, *, without: Sequence[str] = ()
) -> "onnxruntime.InferenceSession":
    # Imported here: it takes longer than all other imports together, and `--help` needs
    # nothing of it.
    import onnxruntime

    providers = ["CPUExecutionProvider"]
    try:
        return onnxruntime.InferenceSession(
            content, _options(), providers=providers, disabled_optimizers=without
        )
    except Exception as error:
        # ONNX Runtime raises a dozen types of its own, all of them about the file.
        raise ModelError(
            f"{path}: not a whole ONNX model ({_first_line(error)}); copy or export "
            "it again"
        ) from None


def _card(path: Path, session: "onnxruntime.InferenceSession") -> ModelCard:
    try:
        text = session.get_modelmeta().custom_metadata_map.get(CARD_KEY)
    except UnicodeDecodeError:
        raise ModelError(
            f"{path}: its metadata is not text in UTF-8; export it again"
        ) from None
    if text is None:
        raise ModelError(
            f"{path}: an ONNX model without a Tactophone card; make one with "
            "`tactophone train`"
        )
    try:
        return ModelCard.from_json(text)
    except (ValueError, KeyError, TypeError) as error:
        raise ModelError(
            f"{path}: its card cannot be used ({_first_line(error)}); train the model "
            "again"
        ) from None


def _options() -> "onnxruntime.SessionOptions":
    """One thread, no spinning: the network takes a fraction of a millisecond, and other
    threads need the processor."""
    import onnxruntime

    options = onnxruntime.SessionOptions()
    options.intra_op_num_threads = options.inter_op_num_threads = 1
    options.add_session_config_entry("session.intra_op.allow_spinning", "0")
    # Not the runtime's own format, which `check_graph` cannot read and which bytes of
    # both kinds could pass for.
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

MODEL_PROBE_TIMEOUT = 5.0
"""Seconds for all inferences at reading."""

PROBE_LEVELS = (0, 1e-4, 1e-3, 1e-2, 1e-1, 1)
"""Levels of the noise that a model is tried with, as a share of full scale: silence,
then from a quiet room at -80 dBFS to full scale."""

SLOWEST = 0.25
"""Seconds of processor time for one inference; the live system has a hundredth of a
second."""

MODEL_TOO_SLOW = "the model is too slow: {:.2f} s of processor time for a window"

_FRACTION = re.compile(r"\d{1,9}(/0*[1-9]\d{0,8}|\.\d{1,9})?")


def _fraction(kind: type, value: Any) -> Fraction:
    # Checked as text first: the fraction of 1e99999999 would take all memory.
    text = str(value) if isinstance(value, str) or type(value) is int else ""
    if not _FRACTION.fullmatch(text):
        raise ValueError("wanted a fraction, such as 64/3")
    return Fraction(text)


def printable(value: Any) -> Any:
    """Replace what a terminal may interpret, such as escape sequences, in all texts of
    nested entries."""
    match value:
        case str():
            return plain(value)
        case dict():
            return {printable(key): printable(entry) for key, entry in value.items()}
        case list():
            return [printable(entry) for entry in value]
    return value


def check_network(session: "onnxruntime.InferenceSession", card: ModelCard) -> None:
    """Raise `ValueError` unless the network maps a window to one row of classes, within
    `MODEL_PROBE_TIMEOUT`."""
    inputs = {each.name: each for each in session.get_inputs()}
    outputs = {each.name: each.type for each in session.get_outputs()}
    stateful = len(inputs) > 1
    types = (
        {SOUND: "float", CONTACT_INPUT: "float", STATE: "double"}
        if stateful
        else {SOUND: "float"}
    )
    if {name: each.type for name, each in inputs.items()} != {
        name: f"tensor({kind})" for name, kind in types.items()
    }:
        raise ValueError(
            f"its input must be {SOUND}, of floats, alone or with {CONTACT_INPUT} and "
            f"{STATE}"
        )
    names = (LOG_PROBABILITIES, FEATURES, *([STATE_OUT] if stateful else []))
    wanted = {
        name: "tensor(double)" if name == STATE_OUT else "tensor(float)"
        for name in names
    }
    if outputs != wanted:
        raise ValueError(f"its output must be {' and '.join(wanted)}")
    shape = inputs[SOUND].shape
    sizes = [card.channels, card.window_size]
    # The number of fingers may be a name instead of 1.
    if shape[1:] != sizes or (type(shape[0]) is int and shape[0] != 1):
        raise ValueError(
            f"its sound has shape {shape}, but by its card it must be {[1, *sizes]}"
        )
    zeros: dict[str, Any] = {SOUND: np.zeros((1, *sizes), np.float32)}
    if stateful:
        size = inputs[STATE].shape[-1]
        if (
            type(size) is not int
            or not 0 < size <= MAX_FEATURES
            or len(inputs[STATE].shape) != 2
        ):
            raise ValueError(
                f"its state has shape {inputs[STATE].shape}, but it must be (1, 1 to "
                f"{MAX_FEATURES})"
            )
        zeros |= {CONTACT_INPUT: np.zeros(1, np.float32), STATE: np.zeros((1, size))}
    found = dict(zip(names, _probe(session, names, zeros), strict=True))
    if found[LOG_PROBABILITIES].shape != (1, len(CLASSES)):
        raise ValueError(
            f"its output has shape {found[LOG_PROBABILITIES].shape}, but it must be "
            f"(1, {len(CLASSES)})"
        )
    if found[FEATURES].ndim != 2 or (
        stateful and found[STATE_OUT].shape != zeros[STATE].shape
    ):
        raise ValueError(
            "its features and its state must be rows, the state of one length"
        )


def _probe(
    session: "onnxruntime.InferenceSession", names: Sequence[str], zeros: dict[str, Any]
) -> list[Any]:
    """Run the network once, in a thread that is ended when it takes too long."""
    import onnxruntime

    options = onnxruntime.RunOptions()
    results = []
    failures = []
    options.log_severity_level = 4

    def run() -> None:
        rng = np.random.default_rng(0)
        try:
            # A network may be quick on silence alone, and slow or of another shape once
            # something is touched.
            for loudness in PROBE_LEVELS:
                noise = (loudness * rng.standard_normal(zeros[SOUND].shape)).astype(
                    np.float32
                )
                touch = (
                    {CONTACT_INPUT: np.full(1, loudness > 0, np.float32)}
                    if CONTACT_INPUT in zeros
                    else {}
                )
                begun = time.thread_time()
                results.append(
                    session.run(names, zeros | {SOUND: noise} | touch, options)
                )
                if (taken := time.thread_time() - begun) > SLOWEST:
                    failures.append(MODEL_TOO_SLOW.format(taken))
        except Exception as error:  # ONNX Runtime raises a dozen types of its own
            failures.append(str(error).strip().partition("\n")[0][:160])

    thread = threading.Thread(target=run, daemon=True)
    thread.start()
    thread.join(MODEL_PROBE_TIMEOUT)
    options.terminate = True
    if thread.is_alive():
        raise ValueError(f"one inference takes over {MODEL_PROBE_TIMEOUT:g} s")
    if failures:
        raise ValueError(f"its network cannot run ({failures[0]})")
    if len({tuple(np.shape(each) for each in result) for result in results}) > 1:
        raise ValueError("the shapes of its outputs depend on the values of its input")
    return list(results[0])


class Engine:
    """Turns windows into probabilities; input and output arrays are allocated once for
    each number of fingers.

    A network whose file names the number of fingers instead of stating 1 computes all
    at once; each finger's result may then differ by its last bits from what it is alone
    (by under 1e-5, a test holds). For others, each is a call.
    """

    def __init__(self, session: "onnxruntime.InferenceSession") -> None:
        inputs = {each.name: each.shape for each in session.get_inputs()}
        outputs = {each.name: each.shape for each in session.get_outputs()}
        self._session, self._alone = session, type(inputs[SOUND][0]) is int
        self._sizes = {name: shape[1:] for name, shape in (inputs | outputs).items()}
        self._inputs = list(inputs)
        self._bound: dict[int, tuple[onnxruntime.IOBinding, dict[str, Any]]] = {}

    def new_state(self) -> Any:
        """Return the state before a touch."""
        return np.zeros(self._sizes.get(STATE, (0,)))

    def run(
        self,
        sound: Sequence[FloatArray],
        contact: Sequence[bool],
        states: Sequence[Any],
    ) -> list[tuple[Probabilities, FloatArray]]:
        """Return the probabilities of none, smooth and rough for each finger, and the
        features that they follow from.

        Each finger's sound has the shape ``(channels, samples)``; its state is changed
        in place. A broken network returns NaN, or numbers that do not sum to 1, and one
        that fails counts as NaN: the caller checks. The features are valid until the
        next run.
        """
        if self._alone and len(sound) > 1:
            parts = (
                self._run(sound[n : n + 1], contact[n : n + 1], states[n : n + 1])
                for n in range(len(sound))
            )
            return [
                (probabilities, features.copy())
                for ((probabilities, features),) in parts
            ]
        return self._run(sound, contact, states)

    def _run(
        self,
        sound: Sequence[FloatArray],
        contact: Sequence[bool],
        states: Sequence[Any],
    ) -> list[tuple[Probabilities, FloatArray]]:
        binding, arrays = self._bound.get(len(sound)) or self._bind(len(sound))
        for row, window in zip(arrays[SOUND], sound, strict=True):
            row[:] = window
        if STATE in arrays:
            arrays[CONTACT_INPUT][:] = contact
            for row, state in zip(arrays[STATE], states, strict=True):
                row[:] = state
        begun = time.thread_time()  # which stands still while this thread has to wait
        try:
            self._session.run_with_iobinding(binding)
        except Exception:  # ONNX Runtime raises a dozen types of its own
            # One sound that the network cannot take is no reason to end a run: the
            # caller withholds and counts what is no number. States stay as they were.
            return [((math.nan,) * 3, np.zeros_like(row)) for row in arrays[FEATURES]]
        if (taken := (time.thread_time() - begun) / len(sound)) > SLOWEST:
            raise ModelError(
                f"{MODEL_TOO_SLOW.format(taken)}; choose another with --model"
            )
        if STATE in arrays:
            for row, state in zip(arrays[STATE_OUT], states, strict=True):
                state[:] = row
        # exp of an invalid value far over 0 would overflow; capped at e it still fails
        # the caller's check.
        probabilities = [
            (
                math.exp(min(none, 1.0)),
                math.exp(min(smooth, 1.0)),
                math.exp(min(rough, 1.0)),
            )
            for none, smooth, rough in arrays[LOG_PROBABILITIES].tolist()
        ]
        return list(zip(probabilities, arrays[FEATURES], strict=True))

    def _bind(self, count: int) -> tuple["onnxruntime.IOBinding", dict[str, Any]]:
        # Bound once: naming and wrapping the arrays at every run takes longer than a
        # small network itself.
        binding = self._session.io_binding()
        arrays = {}
        for name, sizes in self._sizes.items():
            kind: Any = np.float64 if name in (STATE, STATE_OUT) else np.float32
            array = arrays[name] = np.zeros((count, *sizes), kind)
            bind = binding.bind_input if name in self._inputs else binding.bind_output
            bind(name, "cpu", 0, kind, array.shape, array.ctypes.data)
        self._bound[count] = binding, arrays
        return self._bound[count]
