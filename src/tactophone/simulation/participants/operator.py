"""A simulated operator: feels five stones through the vibration alone, and picks the two rough ones.

It learns in practice what rough and smooth feel like, with *other* stones that it is told; then it strokes stone after
stone, adds up the evidence of what it feels, third of a second by third of a second, and leaves each when it is sure
enough: the sequential probability ratio test (Wald 1945), which is how people and monkeys decide about vibration (Gold
& Shadlen, Annu. Rev. Neurosci. 30, 535, 2007). It is not a person; it is the same for every method, and knows nothing
but the vibration.

Strokes are rendered and felt once, into a bank; rounds draw from it, so that a thousand rounds cost seconds.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tactophone.simulation.content.catalogue import TEST, TestObject, catalogue
from tactophone.simulation.content.movement import Script, Visit, explore, log_uniform
from tactophone.simulation.content.synthetic_surfaces import invent
from tactophone.simulation.participants.fingertip_model import GLANCE, INTEGRATION, Percepts, blur, feel_waveform
from tactophone.simulation.physics.modes import Mounting
from tactophone.simulation.physics.scene import row
from tactophone.simulation.physics.session_variation import COMPETITION, SessionVariation
from tactophone.simulation.physics.source import RATE, SimulatedFinger
from tactophone.types import FloatArray, Touch

Felt = Callable[[FloatArray], FloatArray]
"""Both microphones of a visit to a stone, 48 kHz, to the vibration that is felt of it, as long."""

DISCOUNT = 0.5
"""Weight of a piece of evidence: even so far apart they are no independent witnesses (pressure and place last)."""

ERROR = 0.01
"""Accepted probability of a wrong word about a stone."""

SHORTEST, LONGEST = 1.5, 8.0
"""Seconds of stroking before a word is given, and after which one must be."""

TRAVEL = (1.6, 3.0)
"""Seconds from stone to stone, through a camera, with a robot's arm."""

_PIECE = GLANCE * INTEGRATION
"""Seconds of a piece of evidence."""


_LABELS = (Touch.SMOOTH, Touch.ROUGH)


@dataclass(frozen=True, slots=True)
class Visits:
    """Visits as they are heard: to the catalogue's training objects, and to stones that nobody has met."""

    practice: dict[Touch, tuple[FloatArray, ...]]
    rounds: dict[Touch, tuple[FloatArray, ...]]


@dataclass(frozen=True, slots=True)
class Bank:
    """Visits as they are felt: what practice learns from, and what rounds draw from."""

    practice: dict[Touch, tuple[Percepts, ...]]
    rounds: dict[Touch, tuple[Percepts, ...]]


@dataclass(frozen=True, slots=True)
class Round:
    """One round.

    Parameters
    ----------
    success
        Whether the two picked were the two rough.
    found
        Whether the one that felt roughest was rough: the paper's task.
    duration
        Seconds from the first touch to the word, with the way between stones.
    stroked
        Seconds of stroking, a stone each.
    """

    success: bool
    found: bool
    duration: float
    stroked: tuple[float, ...]


@dataclass(frozen=True, slots=True)
class Tally:
    """Shares of rounds won, and the median and quartiles of their duration in s."""

    success: float
    found: float
    duration: float
    quartiles: tuple[float, float]


def render_visits(*, visits: int = 12, seed: int = 0) -> Visits:
    """Render visits to stones in the competition's box as both microphones hear them; the same for every method.

    Parameters
    ----------
    visits
        Of each label, for practice and for rounds.
    seed
        Of set-ups, strokes and noise.
    """
    return Visits(
        practice={label: tuple(_visit(_known(label, k), [seed, 0, k]) for k in range(visits)) for label in _LABELS},
        rounds={label: tuple(_visit(_new(label, seed, k), [seed, 1, k]) for k in range(visits)) for label in _LABELS},
    )


def make_bank(visits: Visits, felt: Felt) -> Bank:
    """Feel all visits through a method."""
    return Bank(practice=_felt(visits.practice, felt), rounds=_felt(visits.rounds, felt))


class Operator:
    """Knows, from practice, how rough and smooth feel through a method.

    Parameters
    ----------
    practice
        Visits to stones whose kind it is told.
    seed
        Of its internal noise.
    """

    def __init__(self, practice: dict[Touch, tuple[Percepts, ...]], *, seed: int = 0) -> None:
        rng = np.random.default_rng([0x0B5E, seed])
        rows = {label: [pieces(blur(one, rng)) for one in some for _ in range(4)] for label, some in practice.items()}
        features = np.concatenate([row for label in _LABELS for row in rows[label]])
        sizes = [sum(map(len, rows[label])) for label in _LABELS]
        rough = np.repeat([label is Touch.ROUGH for label in _LABELS], sizes)
        self._mean, self._scale = np.zeros(features.shape[1]), np.ones(features.shape[1])
        self._weights = np.zeros(features.shape[1] + 1)
        if 0 < rough.sum() < rough.size:  # else nothing was ever felt of one kind, and nothing can be learnt
            self._mean, self._scale = features.mean(axis=0), features.std(axis=0) + 1e-9
            self._weights = _logistic((features - self._mean) / self._scale, rough)

    def evidence(self, percepts: Percepts) -> NDArray[np.float64]:
        """Log-odds of rough that each third of a second adds."""
        features = (pieces(percepts) - self._mean) / self._scale
        return DISCOUNT * (features @ self._weights[1:] + self._weights[0])

    def judge(self, percepts: Percepts) -> tuple[float, float]:
        """Stroke a stone until sure, or until time is up; gives the log-odds of rough, and the seconds it took."""
        # Two stones of five are rough: what is thought of a stone before it is touched.
        odds = np.log(2 / 3) + np.cumsum(self.evidence(percepts))
        if not odds.size:
            return float(np.log(2 / 3)), LONGEST
        time = _PIECE * np.arange(1, odds.size + 1)
        sure = (np.abs(odds) > np.log((1 - ERROR) / ERROR)) & (time >= SHORTEST)
        last = int(np.argmax(sure)) if sure.any() else min(odds.size, round(LONGEST / _PIECE)) - 1
        return float(odds[last]), float(time[last])


def play(bank: Bank, *, rounds: int = 1000, seed: int = 0) -> list[Round]:
    """Play rounds of the task; the same seed draws the same stones, visits and noise for any method."""
    operator = Operator(bank.practice, seed=seed)
    return [_round(operator, bank, np.random.default_rng([0x5EED, seed, number])) for number in range(rounds)]


def tally(rounds: Sequence[Round]) -> Tally:
    """Sum rounds up."""
    low, middle, high = np.quantile([one.duration for one in rounds], [0.25, 0.5, 0.75])
    return Tally(
        success=float(np.mean([one.success for one in rounds])),
        found=float(np.mean([one.found for one in rounds])),
        duration=float(middle),
        quartiles=(float(low), float(high)),
    )


def pieces(percepts: Percepts) -> NDArray[np.float64]:
    """What each third of a second of touch feels like: mean level, its spread, mean pitch, and the share felt."""
    size = percepts.level_db.size // GLANCE * GLANCE
    level = percepts.level_db[:size].reshape(-1, GLANCE)
    pitch = percepts.pitch[:size].reshape(-1, GLANCE)
    felt = level > 0
    count = np.maximum(felt.sum(axis=1), 1)
    rows = np.stack(
        [level.sum(axis=1) / count, level.std(axis=1), pitch.sum(axis=1) / count, felt.mean(axis=1)], axis=1
    )
    return np.asarray(rows[felt.any(axis=1)])


def _known(label: Touch, number: int) -> TestObject:
    things = [one for one in catalogue() if one.label is label and one.movable and one.number not in TEST]
    return replace(things[number % len(things)], mounting=Mounting.MAT)


def _new(label: Touch, seed: int, number: int) -> TestObject:
    return invent(label, np.random.default_rng([0x1273, seed, number, int(label)]))


def _visit(thing: TestObject, seed: Sequence[int]) -> FloatArray:
    """Stroke one stone on the mat in the box until no operator would go on."""
    rng = np.random.default_rng([0x7157, *seed, int(thing.label)])
    scene = row([thing])
    session = int(rng.integers(1 << 30))
    placed = scene.placed[0]
    script = Script(rng, x=placed.centre[0], y=placed.centre[1])
    visit = Visit(LONGEST, log_uniform(rng, (0.5, 2.5)), log_uniform(rng, (0.04, 0.14)), slips=rng.random() < 0.1)
    explore(script, placed, visit)
    setup = SessionVariation.draw(session, COMPETITION)
    finger = SimulatedFinger(scene, script.moves, setup=setup, seed=[*seed, session], place=placed.centre)
    return finger.render(round(script.time * RATE)).samples


def _felt(heard: dict[Touch, tuple[FloatArray, ...]], felt: Felt) -> dict[Touch, tuple[Percepts, ...]]:
    return {label: tuple(feel_waveform(felt(one), RATE) for one in some) for label, some in heard.items()}


def _round(operator: Operator, bank: Bank, rng: np.random.Generator) -> Round:
    order = [Touch.SMOOTH] * 3 + [Touch.ROUGH] * 2
    order = [order[k] for k in rng.permutation(5)]
    odds, stroked = [], []
    for label in order:
        visits = bank.rounds[label]
        found, time = operator.judge(blur(visits[int(rng.integers(len(visits)))], rng))
        odds.append(found)
        stroked.append(time)
    picked = np.argsort(odds)[-2:]
    travel = rng.uniform(*TRAVEL, size=4).sum()
    return Round(
        success=all(order[k] is Touch.ROUGH for k in picked),
        found=order[int(np.argmax(odds))] is Touch.ROUGH,
        duration=float(sum(stroked) + travel),
        stroked=tuple(stroked),
    )


def _logistic(features: NDArray[np.float64], rough: NDArray[np.bool_], *, ridge: float = 1.0) -> NDArray[np.float64]:
    """Weights, the bias first, of a logistic regression with both classes weighing the same; Newton's method."""
    rows = np.column_stack([np.ones(len(features)), features])
    share = np.where(rough, 0.5 / max(rough.sum(), 1), 0.5 / max((~rough).sum(), 1)) * len(rough)
    weights = np.zeros(rows.shape[1])
    penalty = ridge * np.diag([0.0] + [1.0] * features.shape[1])
    for _ in range(25):
        chance = 1 / (1 + np.exp(-np.clip(rows @ weights, -30, 30)))
        slope = rows.T @ (share * (rough - chance)) - penalty @ weights
        curve = (rows * (share * chance * (1 - chance))[:, None]).T @ rows + penalty + 1e-9 * np.eye(rows.shape[1])
        step = np.linalg.solve(curve, slope)
        weights += step
        if np.abs(step).max() < 1e-6:
            break
    return weights
