"""The paper's three tables, with its own numbers beside.

Tables I and II are made on data in its authors' layout. Scores follow the authors'
rule: a window in contact is rough if P(rough) among all three classes is 0.5 or more;
the same moments count for every method. Contact is either the authors' (a mean absolute
value over 0.005) or the paper's text (an RMS over -26 dBFS): where a microphone's noise
is over 0.005, the first counts rests as touch.

Tables I and II train the paper's networks, hours of a core on a whole data set, unless
``--methods`` names others; what was trained is kept. The ablations take half an hour on
a small one. Models train on the training objects alone; the fine-tuned one on fewer,
and on a sample of the competition's stones, as the paper has it. That sample is kin of
the stones that it is tested with, which its row says.

There is one object a class to test with, so no draw of objects says what another pair
of them would change. Intervals come from drawing takes of a test object and pieces of
a competition's run within each class: they show what other recordings of the same
objects would change.

A method ``shipped:NAME`` is a shipped model as it is, by the same rule as the others;
``rendered:NAME`` is what `tactophone feel` renders with it, after its own contact gate
and decision. The decision exists to remove false positives, so these rows are the ones
to hold beside the paper's false positives. What is rendered as none counts as smooth,
as in the authors' rule.

Table III is the paper's task by a simulated operator: five stones, two of them rough,
found by vibration alone. The operator is the same for every method and has no input but
the vibration; it is a model, not a person.

    python benchmarks/paper_tables.py 1 2 --data DIR        DIR in the authors' layout
    python benchmarks/paper_tables.py 1 2 --data DIR --methods rendered:texture
    python benchmarks/paper_tables.py 1 2 --data DIR --form markdown \\
      --methods examples/recipes/tables/fast-general.toml
    python benchmarks/paper_tables.py 3 --rounds 100        shipped models and profiles
    python benchmarks/paper_tables.py 3 --methods texture,finger.onnx
    python benchmarks/paper_tables.py ablations --data DIR  what the authors tried
"""

import argparse
import ast
import hashlib
import math
import re
import sys
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from importlib.resources import files
from itertools import zip_longest
from pathlib import Path

import numpy as np
from numpy.typing import NDArray
from rich.text import Text

from ablations import Ablation
from simulated_operator import (
    SoundToVibration,
    perceive_visits,
    play_rounds,
    render_visits,
)
from tactophone.cli import output
from tactophone.core.errors import (
    ConfigError,
    DatasetError,
    TactophoneError,
    did_you_mean,
)
from tactophone.core.recordings.layouts import SAMPLE, SPARE_OBJECT
from tactophone.core.recordings.values import (
    Dataset,
    Recording,
    Segment,
    fingerprint,
    stretches,
)
from tactophone.core.types import LIVE_SAMPLE_RATE, AudioBlock, FloatArray, Touch
from tactophone.signal.haptics.oscillator import Oscillator
from tactophone.signal.haptics.passthrough import (
    is_passthrough,
    open_passthrough,
    passthrough_names,
)
from tactophone.signal.haptics.profiles import PROFILES
from tactophone.signal.perception.model_file import Gate, read_model
from tactophone.signal.perception.models import model_path, shipped_models
from tactophone.signal.pipeline import open_pipeline
from tactophone_lab.benchmark.folds import Cache, cross_validate, default_cache
from tactophone_lab.benchmark.methods import FULL_DRIVE, NetworkMethod, methods_for
from tactophone_lab.benchmark.plan import origin_of
from tactophone_lab.datasets.open import open_dataset
from tactophone_lab.datasets.splits import Fold, split
from tactophone_lab.evaluation.bootstrap import COVERAGE, Estimate, estimate
from tactophone_lab.evaluation.predict import (
    Predictor,
    TakePredictions,
    in_true_contact,
    model_predictor,
    recording_predictor,
    scores_of,
)
from tactophone_lab.training.baselines import FeatureRecipe
from tactophone_lab.training.recipe_options import (
    LABEL_LEVEL_DBFS,
    NETWORK_RATE,
    NETWORK_WINDOW_SIZE,
    REFERENCE_GATE,
)
from tactophone_lab.training.recipes import RecipeFile
from tactophone_lab.training.tracks import read_signals

GATES: Mapping[str, Gate] = {
    "authors' gate, 0.005": REFERENCE_GATE,
    "paper's gate, -26 dBFS": Gate(LABEL_LEVEL_DBFS),
}
"""Gates that contact is labelled by, where it is not labelled already."""

LABELLED = "contact as labelled"

PAGE_HEAD = """
*Paper's own* rows are real sound of its authors' stones. All others here say whether
their sound is simulated; *box* has the levels that the shipped models were trained
with, *finals* has levels from data sheets and the authors' code, a noisy hall, and
light, slow and short touches (recording-levels.md). In both tasks the smooth stone has
an Ra of 4.5 um, the rough ones of 31.9 and 33.7. `paper-*` trains as the paper does
(five epochs, batches of 6000; every window, as in its authors' notebook), `authors-*`
as its authors' published code does (their labels, class weights 1 / 0.05 / 0.05),
`fast-*` in smaller batches. Brackets are 90 % intervals over takes of the same objects
and 5 s pieces of a run: they say nothing of other objects. *Fine-tuned* has trained on
object 20, a rough stone, and on samples of the competition's stones, smooth and rough,
recorded with another set-up than either day's. *Shipped* rows are models as they are,
*as rendered* is what an operator would feel.
"""

FINE_TUNED = "paper/fine-tuned"
"""Name of the method that is fine-tuned on a sample of the competition's stones."""

KIN_NOTE = " (tuned on their stones)"
"""What its row adds to the name: its sample is kin of a stone in the test."""

METHODS = (
    "paper/general",
    "paper/fine-tuned",
    "paper/one-channel",
    "texture",
    "rendered:texture",
)

SHIPPED = "shipped:"
"""Before a shipped model's name: its windows, by the authors' rule."""

AS_RENDERED = "rendered:"
"""Before a shipped model's name: what `tactophone feel` renders with it."""

NETWORK_CODE = (
    ("tactophone_lab", "training/paper_network.py"),
    ("tactophone_lab", "training/recipe_options.py"),
    ("tactophone_lab", "training/recipes.py"),
    ("tactophone_lab", "training/tracks.py"),
    ("tactophone_lab", "training/trainer.py"),
    ("tactophone", "signal/perception/levels.py"),
    ("tactophone", "signal/perception/resample.py"),
    ("tactophone", "net/link/codec.py"),
)
"""Package and file of the code that trains the paper's network: what it reads,
resamples, labels, and by which options."""

ABLATIONS = Path(__file__).parents[1] / "examples/recipes/ablations"

TABLE_STEP = 20
"""Samples at 2 kHz, 10 ms, from one look at the level to the next."""

SHORT_WINDOW = 64
"""Samples, 32 ms."""

CLEARLY_DB = 12.0
"""So far under the threshold there is nothing but noise; between the two, contact is
unknown."""

TABLE_SHARES = (
    "rough_as_rough",
    "rough_as_smooth",
    "smooth_as_rough",
    "smooth_as_smooth",
)
IN_CONTACT = "in_contact"
"""Column of Table I with the share of windows that count, among the takes of a row."""

IN_CONTACT_DAYS = "days in_contact"
"""Column of Table II: that share among the competition's days alone."""

IN_CONTACT_TEST = "test in_contact"
"""Column of Table II: that share among the test objects alone."""

BOOTSTRAP_PIECE = 5.0
"""Seconds of a competition's run that are drawn as one: several strokes, so that a
stroke is hardly ever cut."""

UNSTATED = Estimate(float("nan"))
"""What the paper does not state, such as the share in contact."""

PAPER_ONE: Mapping[str, tuple[float, ...]] = {
    "competition": (0.113, 0.472, 0.009, 0.405),
    "test": (0.240, 0.265, 0.081, 0.413),
}
"""Table I, general model: shares of all windows, in the order of
:data:`TABLE_SHARES`."""

PAPER_ONE_CHANNEL: Mapping[str, float] = {"competition": 0.033, "test": 0.155}
"""The same for its piezo-only model; the text states only ``smooth_as_rough``."""

TWO_COLUMNS = (
    "rough day 1",
    "rough day 2",
    "smooth day 1",
    "smooth day 2",
    "test rough",
    "test smooth",
)

PAPER_TWO: Mapping[str, tuple[float, ...]] = {
    "general": (0.264, 0.141, 1.000, 0.929, 0.476, 0.836),
    "fine-tuned": (0.239, 0.190, 1.000, 0.959, 0.459, 0.999),
    "one-channel": (0.482, 0.117, 0.998, 0.692, 0.630, 0.736),
}
"""Table II: accuracy of each class."""

SESSION_BLOCK = 512
LIKE_PAPER = ("paper", "graded", "dualsense", "events")
"""Profiles between the paper's two stimuli: one row stands for them."""

PAPER_THREE: Mapping[str, tuple[int | None, int | None]] = {
    "NimbRo": (66, 62),
    "Pollen Robotics": (144, 119),
    "Northeastern": (None, 567),
    "Avatrina": (288, None),
}
"""Table III: each team's time in s, which "includes roughness sensing and stone
retrieval", on days 1 and 2; ``None``: not attempted. ``NimbRo`` are the paper's
authors."""

VISITS = 12
"""Visits of each label, for practice and for rounds; rounds draw from them."""


@dataclass(frozen=True, slots=True)
class TableRow:
    """A row of a table: its name, and its scores by column; NaN where it has no
    score."""

    name: str
    values: dict[str, Estimate]


def predict_held_out(
    dataset: Dataset,
    names: Sequence[str],
    cache: Cache,
    *,
    report: Callable[[str], None] = lambda name: None,
) -> dict[str, list[TakePredictions]]:
    """Train methods on the training objects of the authors' layout; predict its test
    objects and competition runs.

    Without ``names`` they are the paper's three variants and ``texture``; a name may
    name a recipe file. ``report`` is called with each method's name before it
    trains, and with its progress. Raises `DatasetError` if there are no held-out
    recordings.
    """
    kept = dataset.labelled()
    if not any(take.known("split") not in ("train", "") for take in kept.recordings):
        raise DatasetError(
            f"{dataset.root}: has no test objects and no competition runs; Tables I "
            "and II need the authors' layout: "
            "opus/stereo/ and finals_recordings/ (`tactophone simulate dataset "
            "--authors-layout` makes it)"
        )
    # Where contact is not labelled, the authors' test threshold labels it: they score
    # by it.
    recordings = tuple(
        take if take.segments else replace(take, segments=loud_segments(take))
        for take in kept.recordings
    )
    predictions = {}
    names = names or METHODS
    recipes = [Path(name) for name in names if name.endswith(".toml")]
    as_they_are = [name for name in names if name.startswith((SHIPPED, AS_RENDERED))]
    others = [
        name for name in names if not name.endswith(".toml") and name not in as_they_are
    ]
    known = methods_for(replace(kept, recordings=recordings), others) if others else ()
    test = tuple(
        take for take in recordings if take.known("split") not in ("train", "")
    )
    for method in (
        *known,
        *(file_method(path, cache.folder, report) for path in recipes),
    ):
        report(method.name)
        fine_tuned = (
            isinstance(method, NetworkMethod)
            and method.recipe.settings.variant == "fine-tuned"
        )
        # A recipe file labels its windows by its own threshold, not by the segments
        # that the tables score by.
        source = kept.recordings if method not in known else recordings
        train, with_kin = training_takes(
            source, FINE_TUNED if fine_tuned else method.name
        )
        name = method.name + KIN_NOTE * with_kin
        predictions[name] = cross_validate(
            method, [Fold("held out", train, test)], cache=cache
        )
    for name in as_they_are:
        report(name)
        title, predict = shipped_predictor(name)
        predictions[title] = [predict(take) for take in test]
    return predictions


def shipped_predictor(name: str) -> tuple[str, Predictor]:
    """Return the title of a row and the predictor of a shipped model, its windows or
    what is rendered."""
    kind, _, model = name.partition(":")
    if f"{kind}:" == SHIPPED:
        return f"{model}, as shipped", model_predictor(read_model(model_path(model)))
    predict = recording_predictor(model)
    return f"{model}, as rendered", lambda take: as_felt(predict(take))


def as_felt(take: TakePredictions) -> TakePredictions:
    """Return predictions that are certain of what was rendered; where nothing was, the
    authors' rule counts smooth."""
    assert take.touch is not None
    rough = take.touch == Touch.ROUGH
    certain = np.where(rough[:, None], (0, 0, 1), (0, 1, 0)).astype(np.float32)
    return replace(take, probabilities=certain)


REDUCED_OBJECTS = frozenset(range(10, 20))
"""Training objects of the fine-tuned model: the paper says *fewer objects* and does not
name them. These are the casts, which are most like the competition's stones."""


@dataclass(frozen=True, slots=True)
class KeptMethod(NetworkMethod):
    """The paper's network, whose model stays in `folder`.

    An interrupted training continues there, and other test recordings need no new one.
    Only another recipe, other recordings or other code in `NETWORK_CODE` train anew.
    """

    folder: Path = Path()
    report: Callable[[str], None] = lambda note: None

    def fit(self, recordings: Sequence[Recording]) -> Predictor:
        key = training_key(self, recordings)
        path, checkpoint = (
            self.folder / f"{self.title}-{key}.onnx",
            self.folder / f"{self.title}-{key}.unfinished",
        )
        if not path.exists():
            self.folder.mkdir(parents=True, exist_ok=True)
            self.recipe.train(
                path,
                Dataset(self.title, self.folder, tuple(recordings)),
                checkpoint=checkpoint,
                report=lambda done, total, note: self.report(
                    f"{self.title}: {done} of {total}, {note}"
                ),
            )
            checkpoint.unlink(missing_ok=True)
        return model_predictor(read_model(path))


def training_key(method: NetworkMethod, recordings: Sequence[Recording]) -> str:
    """Hash what a model follows from: recipe, recordings and the statements of
    `NETWORK_CODE`, however laid out."""
    code = (
        ast.dump(ast.parse((Path(str(files(package))) / name).read_bytes()))
        for package, name in NETWORK_CODE
    )
    return hashlib.sha256(
        "\n".join((method.identity, fingerprint(recordings), *code)).encode()
    ).hexdigest()[:16]


def file_method(path: Path, folder: Path, report: Callable[[str], None]) -> KeptMethod:
    """Return the paper's network as a recipe file trains it, named as the file; its
    model is kept in `folder`."""
    recipe = RecipeFile.read(path).configured()
    if isinstance(recipe, FeatureRecipe):
        raise ConfigError(
            f"{path}: recipe {recipe.name}, but a table takes files of the paper's "
            "network"
        )
    return KeptMethod(recipe, path.stem, folder, report)


def training_takes(
    recordings: Sequence[Recording], name: str
) -> tuple[tuple[Recording, ...], bool]:
    """Return what a method trains on: the training objects; for the paper's fine-tuned
    model, as the paper says.

    Returns them, and whether samples of the competition's stones are among them.
    """
    train = tuple(take for take in recordings if take.known("split") == "train")
    if name != FINE_TUNED:
        return train, False
    reduced = tuple(
        take
        for take in train
        if take.surface in {f"object {number:02}" for number in REDUCED_OBJECTS}
    )
    stones = tuple(
        take
        for take in recordings
        if take.surface == f"object {SPARE_OBJECT:02}" or take.session == SAMPLE
    )
    labels = {take.label for take in (*reduced, *stones)}
    # A set without those objects has no reduced set either.
    return (train, False) if len(labels) < 2 else ((*reduced, *stones), bool(stones))


def by_gate(
    predictions: Mapping[str, Sequence[TakePredictions]], labelled: Sequence[Recording]
) -> dict[str, dict[str, list[TakePredictions]]]:
    """Return the predictions with contact labelled by each gate; by the data set's own
    labels, if it has any."""
    if any(take.segments for take in labelled):
        return {LABELLED: {name: list(takes) for name, takes in predictions.items()}}
    return {
        title: {
            name: [
                replace(
                    take,
                    recording=replace(
                        take.recording, segments=loud_segments(take.recording, gate)
                    ),
                )
                for take in takes
            ]
            for name, takes in predictions.items()
        }
        for title, gate in GATES.items()
    }


def table_one(predictions: Mapping[str, Sequence[TakePredictions]]) -> list[TableRow]:
    """Return Table I: how windows are classified, as shares of all windows."""
    rows = []
    for part in ("competition", "test"):
        rows.append(
            _published(
                f"paper's own, {part}", (*TABLE_SHARES, IN_CONTACT), PAPER_ONE[part]
            )
        )
        if any(name.endswith("one-channel") for name in predictions):
            stated = (math.nan, math.nan, PAPER_ONE_CHANNEL[part], math.nan)
            rows.append(
                _published(
                    f"paper's own one-channel, {part}",
                    (*TABLE_SHARES, IN_CONTACT),
                    stated,
                )
            )
        for name, takes in predictions.items():
            if of_part := [
                take for take in takes if take.recording.known("split") == part
            ]:
                scores = _measure(of_part)
                shares = {share: scores[share] for share in TABLE_SHARES}
                rows.append(
                    TableRow(
                        f"{name}, {part}",
                        {**shares, IN_CONTACT: contact_share(of_part)},
                    )
                )
    return rows


def table_two(predictions: Mapping[str, Sequence[TakePredictions]]) -> list[TableRow]:
    """Return Table II: the accuracy of each class, day by day."""
    columns = (*TWO_COLUMNS, IN_CONTACT_DAYS, IN_CONTACT_TEST)
    own = [
        _published(f"paper's own, {variant}", columns, row)
        for variant, row in PAPER_TWO.items()
    ]
    classes = (
        (Touch.ROUGH, "day 1"),
        (Touch.ROUGH, "day 2"),
        (Touch.SMOOTH, "day 1"),
        (Touch.SMOOTH, "day 2"),
        (Touch.ROUGH, ""),
        (Touch.SMOOTH, ""),
    )
    rows = []
    for name, takes in predictions.items():
        accuracies = [_accuracy(takes, label, day) for label, day in classes]
        shares = [
            contact_share(
                [take for take in takes if take.recording.known("split") == part]
            )
            for part in ("competition", "test")
        ]
        rows.append(
            TableRow(name, dict(zip(columns, [*accuracies, *shares], strict=True)))
        )
    return [*own, *rows]


ABLATION_COLUMNS = ("balanced_accuracy", "auc", "rough_accuracy", "false_positive_rate")


def ablations_in(folder: Path) -> list[Ablation]:
    """Read the recipe files of a folder; raises `ConfigError` unless all train the
    paper's network."""
    if not (paths := sorted(folder.glob("*.toml"))):
        raise ConfigError(
            f"{folder}: holds no recipe file; examples/recipes/ablations has some"
        )
    return [Ablation.read(path) for path in paths]


def ablation_rows(
    methods: Sequence[Ablation],
    dataset: Dataset,
    name: str,
    cache: Cache,
    *,
    report: Callable[[int, str], None] = lambda done, name: None,
) -> list[TableRow]:
    """Cross-validate ablations on a split of this name; scores of windows in true
    contact."""
    rows = []
    for done, method in enumerate(methods):
        report(done, method.name)
        takes = cross_validate(method, split(dataset, name), cache=cache)
        scores = estimate(scores_of(map(in_true_contact, takes), "two-class"))
        rows.append(
            TableRow(
                method.name, {column: scores[column] for column in ABLATION_COLUMNS}
            )
        )
    return rows


def contact_share(takes: Sequence[TakePredictions]) -> Estimate:
    """Return the share of windows that count as contact; without an interval."""
    total = sum(len(take.time) for take in takes)
    counted = sum(int(in_true_contact(take).contact.sum()) for take in takes)
    return Estimate(counted / total if total else float("nan"))


def loud_segments(
    recording: Recording, gate: Gate = REFERENCE_GATE
) -> tuple[Segment, ...]:
    """Label contact where the window that ends there is over a gate's threshold, none
    where it is far below it."""
    (signal,) = read_signals([recording], channels=1, rate=NETWORK_RATE)
    sizes = (
        np.abs(signal[:, 0])
        if gate.rule == "mean_absolute"
        else np.square(signal[:, 0], dtype=np.float64)
    )
    total = np.concatenate(([0.0], np.cumsum(sizes, dtype=np.float64)))
    ends = np.arange(NETWORK_WINDOW_SIZE, len(signal) + 1, TABLE_STEP)
    loud = _over_threshold_db(total, ends, NETWORK_WINDOW_SIZE, gate) >= 0
    # A long window detects the beginning of a touch late, so silence is looked for with
    # a short one.
    quiet = ~loud & (_over_threshold_db(total, ends, SHORT_WINDOW, gate) < -CLEARLY_DB)
    segments = (*_segments(loud, recording.known("label")), *_segments(quiet, "none"))
    return tuple(sorted(segments, key=lambda segment: segment.start))


def _over_threshold_db(
    total: NDArray[np.float64], ends: NDArray[np.intp], size: int, gate: Gate
) -> NDArray[np.float64]:
    mean = (total[ends] - total[ends - size]) / size
    # A mean of magnitudes is a level, a mean of squares a power.
    return np.asarray(
        (20 if gate.rule == "mean_absolute" else 10) * np.log10(mean + 1e-12)
        - gate.threshold_dbfs
    )


def _segments(on: NDArray[np.bool_], label: str) -> Iterator[Segment]:
    for begin, end in (
        NETWORK_WINDOW_SIZE + TABLE_STEP * stretches(on)
    ) / NETWORK_RATE - TABLE_STEP / NETWORK_RATE:
        yield Segment(float(begin), float(end), label)


def _accuracy(takes: Sequence[TakePredictions], label: Touch, day: str) -> Estimate:
    """The accuracy of a class, of a day's runs or, without a day, of the test
    objects."""
    own = [
        take
        for take in takes
        if take.recording.label is label
        and (
            take.recording.session == day
            if day
            else take.recording.known("split") == "test"
        )
    ]
    return _measure(own)[
        "rough_accuracy" if label is Touch.ROUGH else "smooth_accuracy"
    ]


def _measure(takes: Sequence[TakePredictions]) -> dict[str, Estimate]:
    scored = [piece for take in takes for piece in _pieces(in_true_contact(take))]
    if not any(take.contact.any() for take in scored):
        return dict.fromkeys(
            (*TABLE_SHARES, "rough_accuracy", "smooth_accuracy"), Estimate(float("nan"))
        )
    return estimate(scores_of(scored, "authors"))


def _pieces(take: TakePredictions) -> Iterator[TakePredictions]:
    """Name what the bootstrap draws: a take of a test object, a piece of a
    competition's run."""
    length = (
        BOOTSTRAP_PIECE if take.recording.known("split") == "competition" else math.inf
    )
    number = (take.time // length).astype(int)
    for piece in np.unique(number):
        recording = replace(take.recording, surface=f"{take.recording.path} {piece}")
        here = number == piece
        yield TakePredictions(
            recording, take.time[here], take.probabilities[here], take.contact[here]
        )


def _published(name: str, columns: Sequence[str], values: Sequence[float]) -> TableRow:
    """Return a row of the paper, which states neither intervals nor how much was
    contact."""
    return TableRow(
        name, dict(zip_longest(columns, map(Estimate, values), fillvalue=UNSTATED))
    )


@dataclass(frozen=True, slots=True)
class TaskOutcome:
    """Outcome of the task with one method."""

    name: str
    found: Estimate
    both: Estimate
    """`found` and `both`: share of rounds in which the stone picked first was rough,
    and both picked were."""
    duration: Estimate
    """Decision time in s: median, and 5 to 95 %."""


def task_methods() -> tuple[str, ...]:
    """List the methods: shipped ``MODEL``s, ``texture:PROFILE``, and renderers that
    need no detector."""
    models = [name for name in shipped_models() if not name.endswith("-mono")]
    return (
        *models,
        *(
            f"texture:{name}"
            for name in PROFILES
            if name not in LIKE_PAPER and "texture" in models
        ),
        *passthrough_names(),
    )


def play_task(
    names: Sequence[str] = (),
    *,
    rounds: int = 1000,
    visits: int = VISITS,
    report: Callable[[str], None] = lambda name: None,
) -> list[TaskOutcome]:
    """Let the operator play rounds with each method.

    ``names`` come from :func:`task_methods`, all by default, or ``FILE.onnx`` for any
    other model. Raises `ConfigError` if a name is unknown.
    """
    allowed = task_methods()
    if unknown := [
        name for name in names if name not in allowed and not Path(name).is_file()
    ]:
        hint = did_you_mean(unknown[0], allowed)
        raise ConfigError(
            f"no method {', '.join(unknown)}; there are {', '.join(allowed)}, and "
            f"model files{hint}"
        )
    report("rendering visits")
    sound = render_visits(visits=visits)
    outcomes = []
    for name in names or allowed:
        report(name)
        played = play_rounds(perceive_visits(sound, vibration_of(name)), rounds=rounds)
        found, both = (
            np.array([getattr(game, field) for game in played])
            for field in ("found", "success")
        )
        p5, p50, p95 = np.quantile(
            [game.duration for game in played], [0.05, 0.5, 0.95]
        )
        outcomes.append(
            TaskOutcome(
                name,
                _share(found),
                _share(both),
                Estimate(float(p50), float(p5), float(p95)),
            )
        )
    return outcomes


def vibration_of(name: str) -> SoundToVibration:
    """Return the function from both microphones to the vibration: the live pipeline and
    oscillator, or a renderer."""
    if is_passthrough(name):
        return open_passthrough(name, FULL_DRIVE).render_whole
    model, _, profile = name.partition(":")
    return lambda sound: _render(sound, model, profile or "paper")


def _render(sound: FloatArray, model: str, profile: str) -> FloatArray:
    pipeline = open_pipeline(
        model,
        sample_rate=LIVE_SAMPLE_RATE,
        channels=2,
        profile=profile,
        limits=FULL_DRIVE,
    )
    oscillator = Oscillator(FULL_DRIVE)
    out = np.zeros(len(sound), np.float32)
    for start in range(0, len(sound), SESSION_BLOCK):
        step = pipeline.push(
            AudioBlock(sound[start : start + SESSION_BLOCK], LIVE_SAMPLE_RATE, start)
        )
        if step.command:
            oscillator.submit(step.command)
        oscillator.render(out[start : start + SESSION_BLOCK])
    return out


def _share(won: NDArray[np.bool_]) -> Estimate:
    """Return a share with Wilson's interval (J. Am. Stat. Assoc. 22, 1927)."""
    from scipy.stats import binomtest

    found = binomtest(int(won.sum()), len(won))
    low, high = found.proportion_ci(COVERAGE, method="wilson")
    return Estimate(float(found.statistic), float(low), float(high))


def print_held_out(
    dataset: Dataset,
    tables: Sequence[str],
    names: Sequence[str],
    cache: Cache,
    form: str,
) -> None:
    """Print Table I or II, or both, of a data set in the authors' layout."""
    with output.progress("Tables I and II") as update:
        predictions = predict_held_out(
            dataset, names, cache, report=lambda name: update(note=name)
        )
    for gate, gated in by_gate(predictions, dataset.recordings).items():
        for number, make, title in (
            ("1", table_one, "Table I"),
            ("2", table_two, "Table II"),
        ):
            if number in tables:
                heading = f"{title}, {dataset.name} ({origin_of(dataset)}), {gate}"
                rows = make(gated)
                if form == "markdown":
                    print_markdown(
                        heading, [{"": row.name, **row.values} for row in rows]
                    )
                else:
                    values = {"title": heading, "lines": rows}
                    output.show(
                        values, paper_parts(heading, rows), as_json=form == "json"
                    )
    kept = sorted(path.stem for path in cache.folder.glob("*.onnx"))
    if form == "markdown" and kept:
        print(
            "\nModels, each by the hash of its recipe, its recordings and the code "
            f"that trains it: {', '.join(kept)}."
        )


def print_markdown(title: str, rows: Sequence[Mapping[str, object]]) -> None:
    """Print a table of a page."""
    print(
        f"\n## {title}\n\n| {' | '.join(name.replace('_', ' ') for name in rows[0])} |"
    )
    print(f"|{'|'.join('--:' if name else '---' for name in rows[0])}|")
    for row in rows:
        print(f"| {' | '.join(map(str, row.values()))} |")


def paper_parts(title: str, rows: Sequence[TableRow]) -> list[output.Part]:
    """Return one of the paper's Tables I and II as eight columns in 80 characters, a
    heading's word a line."""
    cells = [{"": row.name, **_narrow(row.values)} for row in rows]
    note = Text(
        "Below a score, its 90 % interval over takes of the test objects and 5 s "
        "pieces of the competition's runs: one "
        "object a class says nothing of other objects."
    )
    return [title, output.table(cells, padding=(0, 1, 0, 0)), note]


def _narrow(values: Mapping[str, Estimate]) -> dict[str, str]:
    """Return the cells of a row, with both shares in contact in one, so that eight
    columns fit."""
    cells = {re.sub("[_ ]", "\n", name): _cell(value) for name, value in values.items()}
    shares = [
        cells.pop(re.sub("[_ ]", "\n", name), None)
        for name in (IN_CONTACT_DAYS, IN_CONTACT_TEST)
    ]
    if shares[0] is not None:
        cells["in\ncontact\ndays,\ntest"] = "\n".join(map(str, shares))
    return cells


def _cell(score: Estimate) -> str:
    if math.isnan(score.low):
        return "-" if math.isnan(score.value) else f"{score.value:.3f}"
    # Two lines, and no leading zeros, so that eight columns fit.
    low, high = (f"{end:.2f}".removeprefix("0") for end in (score.low, score.high))
    return f"{score.value:.3f}\n{low}-{high}"


def print_task(names: Sequence[str], rounds: int, form: str) -> None:
    """Print Table III: as the paper has it, and by the simulated operator."""
    names = names or task_methods()
    with output.progress("simulated operator", len(names) + 1) as update:
        outcomes = play_task(
            names, rounds=rounds, report=lambda name: update(advance=1, note=name)
        )
    times = [
        (team, day, time)
        for team, own in PAPER_THREE.items()
        for day, time in enumerate(own, 1)
    ]
    paper = [
        {"name": f"paper's own: {team}, day {day}", "task": time}
        for team, day, time in times
    ]
    teams: dict[str, dict[str, str]] = {team: {"team": team} for team in PAPER_THREE}
    for team, day, time in times:
        teams[team][f"day {day}"] = (
            "N/A" if time is None else f"{time // 60}:{time % 60:02}"
        )
    headings = ("method", "rough one found", "both found", "decision time (s)")
    found = [
        dict(
            zip(
                headings,
                (each.name, each.found, each.both, each.duration.written(".1f", ".1f")),
                strict=True,
            )
        )
        for each in outcomes
    ]
    first = (
        "Table III as the paper has it: min:s, sensing and retrieval of a rough "
        "stone; N/A: not attempted"
    )
    second = (
        "Table III: SIMULATED OPERATOR, five stones, two of them rough, "
        f"{rounds} rounds a method"
    )
    note = (
        "Shares with 90 % intervals, times as median and 5 to 95 %. The operator "
        "practises on the catalogue's training "
        "objects, on which the shipped models are trained, and plays with stones new "
        "to both. The paper's teams are "
        "people with a robot, who also moved an arm and fetched the stone."
    )
    if form == "markdown":
        print_markdown(first, list(teams.values()))
        print_markdown(second, found)
        print(f"\n{note}")
        return
    values = [
        *paper,
        *({**asdict(each), "task": each.duration.value} for each in outcomes),
    ]
    output.show(
        values,
        [first, list(teams.values()), second, found, note],
        as_json=form == "json",
    )


def print_ablations(
    dataset: Dataset, recipes: Path, name: str, cache: Cache, form: str
) -> None:
    """Print the scores of the paper's network by each recipe file in a folder."""
    methods = ablations_in(recipes)
    with output.progress("ablations", len(methods)) as update:
        rows = ablation_rows(
            methods,
            dataset,
            name,
            cache,
            report=lambda done, of: update(completed=done, note=of),
        )
    title = (
        f"The paper's network and what its authors tried, {dataset.name} "
        f"({origin_of(dataset)}), {name}"
    )
    table = [
        {
            "network": row.name,
            **{name: str(value) for name, value in row.values.items()},
        }
        for row in rows
    ]
    note = "Windows in true contact, two-class rule; 90 % intervals over surfaces."
    if form == "markdown":
        print_markdown(title, [{"network": row.name, **row.values} for row in rows])
        print(f"\n{note}")
        return
    output.show(
        {"title": title, "lines": rows}, [title, table, note], as_json=form == "json"
    )


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("tables", nargs="+", choices=("1", "2", "3", "ablations"))
    parser.add_argument(
        "--data",
        type=Path,
        action="append",
        default=[],
        metavar="DIR",
        help="recordings in the authors' layout, repeatable; any for ablations, the "
        "first",
    )
    parser.add_argument(
        "--methods",
        default="",
        metavar="LIST",
        help="names, recipe files; for 3 also model files (default for 1 and 2: "
        f"{', '.join(METHODS)}; for 3: all)",
    )
    parser.add_argument(
        "--rounds",
        type=int,
        default=1000,
        metavar="N",
        help="of the task for each method (default: %(default)s)",
    )
    parser.add_argument(
        "--recipes",
        type=Path,
        default=ABLATIONS,
        metavar="DIR",
        help="recipe files of the ablations (default: examples/recipes/ablations)",
    )
    parser.add_argument(
        "--split", default="3-fold", help="of the ablations (default: %(default)s)"
    )
    parser.add_argument(
        "--cache",
        type=Path,
        metavar="DIR",
        help="for what was trained (default: the user's cache)",
    )
    parser.add_argument(
        "--form",
        choices=("terminal", "json", "markdown"),
        default="terminal",
        help="of the tables",
    )
    args = parser.parse_args()
    cache = Cache(args.cache) if args.cache else default_cache()
    names = [name for name in args.methods.split(",") if name]
    if args.form == "markdown" and "1" in args.tables:
        print(PAGE_HEAD)
    try:
        if {"1", "2", "ablations"} & {*args.tables} and not args.data:
            raise ConfigError(
                "--data is missing: `tactophone simulate dataset DIR "
                "--authors-layout` makes some"
            )
        for folder in args.data if {"1", "2"} & {*args.tables} else ():
            print_held_out(open_dataset(folder), args.tables, names, cache, args.form)
        if "3" in args.tables:
            print_task(names, args.rounds, args.form)
        if "ablations" in args.tables:
            print_ablations(
                open_dataset(args.data[0]).labelled(),
                args.recipes,
                args.split,
                cache,
                args.form,
            )
    except TactophoneError as error:
        sys.exit(f"paper_tables: {error}")


if __name__ == "__main__":
    main()
