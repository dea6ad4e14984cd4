"""The competition's task by a simulated operator: five stones, two rough, found by the vibration alone.

It is the same operator for every method and knows nothing but what it feels; it is not a person.
"""

from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactophone.errors import ConfigError
from tactophone.evaluation.bootstrap import COVERAGE
from tactophone.haptics import PASSTHROUGH, PROFILES, Oscillator
from tactophone.perception import shipped_models
from tactophone.pipeline import open_pipeline
from tactophone.simulation.participants.operator import Felt, make_bank, play, render_visits
from tactophone.types import AudioBlock, FloatArray

RATE = 48_000
BLOCK_SIZE = 512
VISITS = 12
"""Visits of each label, for practice and for rounds; rounds draw from them."""


@dataclass(frozen=True, slots=True)
class Outcome:
    """How the task went through one method; shares with 90 % intervals, times as median and 5 to 95 %."""

    name: str
    found: str
    both: str
    duration: str
    success: float
    median_duration: float

    def as_json(self) -> dict[str, Any]:
        """Give a plain dictionary."""
        return asdict(self)


def ways_to_feel() -> tuple[str, ...]:
    """List what can be felt through: ``MODEL`` or ``MODEL:PROFILE``, and renderers that need no detector."""
    models = [name for name in shipped_models() if not name.endswith("-mono")]
    return (*models, *(f"ours:{name}" for name in PROFILES if name != "paper" and "ours" in models), *PASSTHROUGH)


def play_task(
    names: Sequence[str] = (),
    *,
    rounds: int = 1000,
    visits: int = VISITS,
    seed: int = 0,
    report: Callable[[str], None] = lambda name: None,
) -> list[Outcome]:
    """Let the operator play rounds through each method.

    Raises
    ------
    ConfigError
        If a name is unknown.
    """
    allowed = ways_to_feel()
    if unknown := [name for name in names if name not in allowed]:
        raise ConfigError(f"cannot feel through {', '.join(unknown)}; there are {', '.join(allowed)}")
    report("rendering visits")
    heard = render_visits(visits=visits, seed=seed)
    outcomes = []
    for name in names or allowed:
        report(name)
        played = play(make_bank(heard, felt_through(name)), rounds=rounds, seed=seed)
        outcomes.append(
            _outcome(
                name,
                np.array([one.found for one in played]),
                np.array([one.success for one in played]),
                np.array([one.duration for one in played]),
            )
        )
    return outcomes


def felt_through(name: str) -> Felt:
    """Make the way from both microphones to the vibration: the live walk and its oscillator, or a sounding profile."""
    if name in PASSTHROUGH:
        return lambda sound: PASSTHROUGH[name](None).render_whole(sound)
    model, _, profile = name.partition(":")
    return lambda sound: _walked(sound, model, profile or "paper")


def _walked(sound: FloatArray, model: str, profile: str) -> FloatArray:
    walk, oscillator = open_pipeline(model, sample_rate=RATE, channels=2, profile=profile), Oscillator()
    out = np.zeros(len(sound), np.float32)
    for start in range(0, len(sound), BLOCK_SIZE):
        tick = walk.push(AudioBlock(sound[start : start + BLOCK_SIZE], RATE, start))
        if tick.command:
            oscillator.submit(tick.command)
        oscillator.render(out[start : start + BLOCK_SIZE])
    return out


def _outcome(name: str, found: NDArray[np.bool_], both: NDArray[np.bool_], duration: NDArray[np.float64]) -> Outcome:
    low, middle, high = np.quantile(duration, [0.05, 0.5, 0.95])
    return Outcome(
        name, _share(found), _share(both), f"{middle:.1f} ({low:.1f}-{high:.1f})", float(both.mean()), float(middle)
    )


def _share(won: NDArray[np.bool_]) -> str:
    """Tell a share with Wilson's interval (J. Am. Stat. Assoc. 22, 1927)."""
    z = {0.90: 1.645}[COVERAGE]
    share, count = float(won.mean()), len(won)
    middle = (share + z**2 / 2 / count) / (1 + z**2 / count)
    half = z * np.sqrt(share * (1 - share) / count + z**2 / 4 / count**2) / (1 + z**2 / count)
    return f"{share:.3f} ({middle - half:.2f}-{middle + half:.2f})"
