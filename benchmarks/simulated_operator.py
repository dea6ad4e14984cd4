"""A simulated operator: explores five stones through the vibration alone, and picks the
two rough ones.

It perceives the vibration as a fingertip does, as level above threshold and pitch,
every 30 ms. Sensation level is the vibration's level over the detection threshold at
its frequency (Verrillo, J. Acoust. Soc. Am. 35, 1962, 1963: flat to 40 Hz, falling by
12 dB an octave from there to 250 Hz, rising again beyond). Internal noise masks smaller
differences than the just-noticeable ones: 18 % of frequency (Pongrac, Multimedia
Systems 13, 297, 2008), 1.5 dB of level (a Weber fraction of 0.2, the finest of the
published 0.2 to 0.58).

In practice it learns the vibration of rough and smooth from *other* stones with known
labels. In a round it strokes stone after stone, accumulates evidence every third of a
second, and leaves a stone when it is sure enough: the sequential probability ratio test
(Wald 1945), which describes how people and monkeys decide about vibration (Gold &
Shadlen, Annu. Rev. Neurosci. 30, 535, 2007). It is not a person; it is the same for
every method, and its only input is the vibration.

Visits are rendered and perceived once; rounds draw from them, so that a thousand rounds
take seconds.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any, Generic, TypeVar

import numpy as np
from numpy.typing import NDArray

from tactophone.core.types import LIVE_SAMPLE_RATE, SURFACE_LABELS, FloatArray, Touch
from tactophone.signal.haptics.psychophysics import (
    FULL_DRIVE_DB,
    LEVEL_JND_DB,
    PITCH_JND,
    threshold_db,
)
from tactophone_lab.simulation.catalogue import TEST, SimulatedObject, blend, catalogue
from tactophone_lab.simulation.microphone_models import COMPETITION, SessionVariation
from tactophone_lab.simulation.modes import Body, Mounting
from tactophone_lab.simulation.motion import row
from tactophone_lab.simulation.source import SimulatedFinger
from tactophone_lab.simulation.strokes import Script, Visit, explore, log_uniform
from tactophone_lab.simulation.surface import Surface

INTEGRATION = 0.03
"""Seconds; the shortest burst that people perceive as a vibration."""

GLANCE = 10
"""Values in a third of a second, which count as a single observation."""

_D_PRIME = 0.954
"""Distance in standard deviations of two stimuli recognised three times in four
(Macmillan & Creelman 2005, A5.2)."""

LOWEST = 15.0
"""Lowest vibration that the fingertip of the model perceives, in Hz."""

HIGHEST = 1000.0
"""Highest vibration that the fingertip of the model perceives, in Hz."""

_ZERO_PADDING = 4
_HALF_WIDTH = 2 / INTEGRATION
"""Hz; half the width of a sine's spectral main lobe in so short a window."""


@dataclass(frozen=True, slots=True, eq=False)
class Percepts:
    """A vibration as perceived, one value every ``INTEGRATION`` seconds, before
    internal noise."""

    level_db: NDArray[np.float64]
    """Over threshold; 0 where nothing is perceived."""
    pitch: NDArray[np.float64]
    """Natural logarithm of the frequency in Hz; 0 where nothing is perceived."""


def perceive(waveform: FloatArray, rate: int) -> Percepts:
    """Compute the percepts of a rendered vibration, shape ``(samples,)``, from -1 to 1
    of full drive."""
    size = round(INTEGRATION * rate)
    windows = np.asarray(waveform[: len(waveform) // size * size], np.float64).reshape(
        -1, size
    )
    taper = np.hanning(size)
    power = np.abs(np.fft.rfft(windows * taper, _ZERO_PADDING * size)) ** 2
    frequency = np.asarray(np.fft.rfftfreq(_ZERO_PADDING * size, 1 / rate), np.float64)
    weighted = (
        power
        * 10 ** (-threshold_db(frequency) / 10)
        * ((frequency > LOWEST) & (frequency < HIGHEST))
    )
    full = (
        _ZERO_PADDING * size * (taper**2).sum() / 4
    )  # total power of a full-scale sine, by Parseval's theorem
    level = FULL_DRIVE_DB + 10 * np.log10(weighted.sum(axis=1) / full + 1e-20)
    return Percepts(
        np.maximum(level, 0.0),
        np.where(level > 0, _pitch(power, weighted, frequency), 0.0),
    )


def _pitch(
    power: NDArray[np.float64],
    weighted: NDArray[np.float64],
    frequency: NDArray[np.float64],
) -> NDArray[np.float64]:
    """Log-frequency of the strongest perceived component.

    It is the centroid of the *unweighted* lobe around the weighted peak, which the
    threshold's slope would shift.
    """
    peak = frequency[np.argmax(weighted, axis=1)]
    lobe = power * (np.abs(frequency - peak[:, None]) < _HALF_WIDTH)
    centroid = (lobe * frequency).sum(axis=1) / np.maximum(lobe.sum(axis=1), 1e-30)
    return np.asarray(np.log(np.maximum(centroid, 1.0)))


def add_internal_noise(percepts: Percepts, rng: np.random.Generator) -> Percepts:
    """Add the internal noise that makes just-noticeable differences just noticeable.

    It is drawn per glance, not per value: just-noticeable differences are measured on
    whole bursts, and longer bursts are distinguished little better. A further draw for
    the whole vibration models that people remember an object no more precisely than a
    single glance.
    """
    perceived = percepts.level_db > 0
    level = percepts.level_db + _noise(perceived.size, rng) * LEVEL_JND_DB / _D_PRIME
    pitch = (
        percepts.pitch + _noise(perceived.size, rng) * np.log1p(PITCH_JND) / _D_PRIME
    )
    return Percepts(
        np.where(perceived, np.maximum(level, 0.0), 0.0),
        np.where(perceived, pitch, 0.0),
    )


def _noise(size: int, rng: np.random.Generator) -> NDArray[np.float64]:
    glances = rng.standard_normal(-(-size // GLANCE))
    return np.repeat(glances, GLANCE)[:size] + rng.standard_normal()


Representation = TypeVar("Representation")

SoundToVibration = Callable[[FloatArray], FloatArray]
"""Sound of a visit, shape ``(samples, 2)`` at 48 kHz, to the rendered vibration, shape
``(samples,)``."""

DISCOUNT = 0.5
"""Weight of an observation: observations of a visit are not independent, as pressure
and place last longer."""

STROKE_ERROR = 0.01
"""Accepted probability of a wrong decision about a stone."""

SHORTEST = 1.5
"""Seconds of stroking before a decision is allowed."""

LONGEST = 8.0
"""Seconds of stroking after which a decision is due."""

TRAVEL = (1.6, 3.0)
"""Seconds from stone to stone, through a camera, with a robot's arm."""

_OBSERVATION = GLANCE * INTEGRATION
"""Seconds of an observation."""


@dataclass(frozen=True, slots=True)
class Visits(Generic[Representation]):
    """Visits by label, as sound or as percepts: training objects for practice,
    synthetic stones for rounds."""

    practice: dict[Touch, tuple[Representation, ...]]
    rounds: dict[Touch, tuple[Representation, ...]]


@dataclass(frozen=True, slots=True)
class OperatorRound:
    """Result of a round."""

    success: bool
    """Whether the two picked stones are the two rough ones."""
    found: bool
    """Whether the stone picked as roughest is rough: the paper's task."""
    duration: float
    """Seconds from the first touch to the decision, travel between stones included."""


def render_visits(*, visits: int = 12, seed: int = 0) -> Visits[FloatArray]:
    """Render ``visits`` per label and purpose to stones in the competition's box; the
    same for every method."""
    practice, rounds = {}, {}
    for label in SURFACE_LABELS:
        movable = [each for each in catalogue() if each.movable]
        known = [
            each for each in movable if each.label is label and each.number not in TEST
        ]
        known = [
            replace(known[k % len(known)], mounting=Mounting.MAT) for k in range(visits)
        ]
        new = (
            synthetic_object(
                label, np.random.default_rng([0x1273, seed, k, int(label)])
            )
            for k in range(visits)
        )
        practice[label] = tuple(
            _visit(obj, [seed, 0, k]) for k, obj in enumerate(known)
        )
        rounds[label] = tuple(_visit(obj, [seed, 1, k]) for k, obj in enumerate(new))
    return Visits(practice, rounds)


def perceive_visits(
    visits: Visits[FloatArray], to_vibration: SoundToVibration
) -> Visits[Percepts]:
    """Compute the percepts of all visits through a method."""

    def perceived(
        sounds: dict[Touch, tuple[FloatArray, ...]],
    ) -> dict[Touch, tuple[Percepts, ...]]:
        return {
            label: tuple(
                perceive(to_vibration(sound), LIVE_SAMPLE_RATE) for sound in own
            )
            for label, own in sounds.items()
        }

    return Visits(practice=perceived(visits.practice), rounds=perceived(visits.rounds))


class Operator:
    """An ideal observer, trained on the percepts of rough and smooth through a
    method."""

    def __init__(
        self, practice: dict[Touch, tuple[Percepts, ...]], *, seed: int = 0
    ) -> None:
        from sklearn.linear_model import LogisticRegression

        rng = np.random.default_rng([0x0B5E, seed])
        rows = {
            label: [
                observations(add_internal_noise(visit, rng))
                for visit in visits
                for _ in range(4)
            ]
            for label, visits in practice.items()
        }
        features = np.concatenate(
            [row for label in SURFACE_LABELS for row in rows[label]]
        )
        sizes = [sum(map(len, rows[label])) for label in SURFACE_LABELS]
        rough = np.repeat([label is Touch.ROUGH for label in SURFACE_LABELS], sizes)
        self._mean, self._scale = (
            np.zeros(features.shape[1]),
            np.ones(features.shape[1]),
        )
        self._weights = np.zeros(features.shape[1] + 1)
        if (
            0 < rough.sum() < rough.size
        ):  # otherwise a label was never perceived, and there is nothing to learn
            self._mean, self._scale = features.mean(axis=0), features.std(axis=0) + 1e-9
            model = LogisticRegression(
                class_weight="balanced", solver="newton-cholesky", tol=1e-8
            )
            model.fit((features - self._mean) / self._scale, rough)
            self._weights = np.append(model.intercept_, model.coef_)

    def evidence(self, percepts: Percepts) -> NDArray[np.float64]:
        """Return the log-odds of rough that each observation adds."""
        features = (observations(percepts) - self._mean) / self._scale
        return DISCOUNT * (features @ self._weights[1:] + self._weights[0])

    def decide(self, percepts: Percepts) -> tuple[float, float]:
        """Stroke a stone until sure, or for `LONGEST` s; return the log-odds of rough
        and the seconds spent."""
        # Prior: two stones of five are rough.
        odds = np.log(2 / 3) + np.cumsum(self.evidence(percepts))
        if not odds.size:
            return float(np.log(2 / 3)), LONGEST
        time = _OBSERVATION * np.arange(1, odds.size + 1)
        sure = (np.abs(odds) > np.log((1 - STROKE_ERROR) / STROKE_ERROR)) & (
            time >= SHORTEST
        )
        last = (
            int(np.argmax(sure))
            if sure.any()
            else min(odds.size, round(LONGEST / _OBSERVATION)) - 1
        )
        return float(odds[last]), float(time[last])


def play_rounds(
    visits: Visits[Percepts], *, rounds: int = 1000, seed: int = 0
) -> list[OperatorRound]:
    """Play rounds of the task; the same seed draws the same stones, visits and noise
    for any method."""
    operator = Operator(visits.practice, seed=seed)
    return [
        _round(operator, visits, np.random.default_rng([0x5EED, seed, number]))
        for number in range(rounds)
    ]


def observations(percepts: Percepts) -> NDArray[np.float64]:
    """Return features of each third of a second with touch, shape ``(observations,
    4)``.

    They are mean level, its deviation, mean pitch, and the share of perceived values.
    """
    size = percepts.level_db.size // GLANCE * GLANCE
    level = percepts.level_db[:size].reshape(-1, GLANCE)
    pitch = percepts.pitch[:size].reshape(-1, GLANCE)
    perceived = level > 0
    count = np.maximum(perceived.sum(axis=1), 1)
    rows = np.stack(
        [
            level.sum(axis=1) / count,
            level.std(axis=1),
            pitch.sum(axis=1) / count,
            perceived.mean(axis=1),
        ],
        axis=1,
    )
    return np.asarray(rows[perceived.any(axis=1)])


def _visit(obj: SimulatedObject, seed: Sequence[int]) -> FloatArray:
    """Stroke a stone on the mat in the box for `LONGEST` s; return the sound."""
    rng = np.random.default_rng([0x7157, *seed, int(obj.label)])
    scene = row([obj])
    session = int(rng.integers(1 << 30))
    placed = scene.placed[0]
    script = Script(rng, x=placed.centre[0], y=placed.centre[1])
    visit = Visit(
        LONGEST,
        log_uniform(rng, (0.5, 2.5)),
        log_uniform(rng, (0.04, 0.14)),
        slips=rng.random() < 0.1,
    )
    explore(script, placed, visit)
    variation = SessionVariation.draw(session, COMPETITION)
    finger = SimulatedFinger(
        scene,
        script.moves,
        session=variation,
        seed=[*seed, session],
        place=placed.centre,
    )
    return finger.render(round(script.time * LIVE_SAMPLE_RATE)).samples


def _round(
    operator: Operator, visits: Visits[Percepts], rng: np.random.Generator
) -> OperatorRound:
    order = [Touch.SMOOTH] * 3 + [Touch.ROUGH] * 2
    order = [order[k] for k in rng.permutation(5)]
    odds, stroked = [], 0.0
    for label in order:
        choices = visits.rounds[label]
        rough, time = operator.decide(
            add_internal_noise(choices[int(rng.integers(len(choices)))], rng)
        )
        odds.append(rough)
        stroked += time
    picked = np.argsort(odds)[-2:]
    travel = rng.uniform(*TRAVEL, size=4).sum()
    return OperatorRound(
        success=all(order[k] is Touch.ROUGH for k in picked),
        found=order[int(np.argmax(odds))] is Touch.ROUGH,
        duration=float(stroked + travel),
    )


MASS = (0.15, 0.7)
"""Kilograms of a stone that a hand can lift."""


def synthetic_object(label: Touch, rng: np.random.Generator) -> SimulatedObject:
    """Blend two movable objects of this label into a new one, in the competition's box.

    >>> stone = synthetic_object(Touch.ROUGH, np.random.default_rng(0))
    >>> stone.label, stone.roughness.ra > 5e-6
    (<Touch.ROUGH: 2>, True)
    """
    parents = [obj for obj in catalogue() if obj.label is label and obj.movable]
    first, second = (parents[k] for k in rng.choice(len(parents), 2, replace=False))
    share = float(rng.uniform(0.2, 0.8))
    return replace(
        first,
        number=-2,
        name=f"synthetic {label.name.lower()} stone",
        surface=_blended_surface(first.surface, second.surface, share, rng),
        material=blend(first.material, second.material, share),
        substance=f"between {first.substance} and {second.substance}",
        body=Body.SHELL if rng.random() < 0.5 else Body.BLOCK,
        mounting=Mounting.MAT,
        mass=float(rng.uniform(*MASS)),
    )


def _blended_surface(
    first: Surface, second: Surface, share: float, rng: np.random.Generator
) -> Surface:
    features: dict[str, Any] = {}
    for name in ("grains", "pits", "ridges"):
        a, b = getattr(first, name), getattr(second, name)
        # A feature that only one parent has is inherited whole or not at all.
        if a is not None and b is not None:
            features[name] = blend(a, b, share)
        elif rng.random() < share:
            features[name] = a
        else:
            features[name] = b
    plain = replace(
        first,
        grains=None,
        pits=None,
        ridges=None,
        name="synthetic",
        seed=int(rng.integers(1 << 30)),
    )
    blended = blend(plain, replace(second, grains=None, pits=None, ridges=None), share)
    return replace(blended, name=plain.name, seed=plain.seed, **features)
