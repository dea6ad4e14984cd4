"""The paper's task (Table III) by a simulated operator: five stones, two of them rough, found by vibration alone.

The operator is the same for every method and has no input but the vibration; it is a model, not a person.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
from numpy.typing import NDArray

from tactophone.benchmark.regression_features import FULL_DRIVE
from tactophone.errors import ConfigError, did_you_mean
from tactophone.evaluation.bootstrap import COVERAGE
from tactophone.haptics import PASSTHROUGH, PROFILES, Oscillator
from tactophone.perception import shipped_models
from tactophone.pipeline import open_pipeline
from tactophone.simulation import SoundToVibration, perceive_visits, play_rounds, render_visits
from tactophone.types import LIVE_SAMPLE_RATE, AudioBlock, FloatArray

BLOCK_SIZE = 512
LIKE_PAPER = ("paper", "dualsense", "events")
"""Profiles that render roughness as the paper's does: one row stands for them."""

PAPER_THREE: Mapping[str, str] = MappingProxyType(
    {"NimbRo, day 1": "66", "NimbRo, day 2": "62", "fastest of three rivals": "119", "slowest of them": "567"}
)
"""Table III: time in s from the begin of the task until a rough stone was fetched; of the rivals the paper's range."""

VISITS = 12
"""Visits of each label, for practice and for rounds; rounds draw from them."""


@dataclass(frozen=True, slots=True)
class TaskOutcome:
    """Outcome of the task with one method."""

    name: str
    found: str
    both: str
    """`found` and `both`: share of rounds in which the stone picked first was rough, and both picked were; with 90 %
    intervals."""
    duration: str
    """Decision time in s: median, and 5 to 95 %."""
    success: float
    median_duration: float
    """`success` and `median_duration`: the share of ``both`` and the median of ``duration``, as numbers."""

    def as_json(self) -> dict[str, Any]:
        """Return a plain dictionary."""
        return asdict(self)


def task_methods() -> tuple[str, ...]:
    """List the methods: shipped ``MODEL``s, ``texture:PROFILE``, and renderers that need no detector."""
    models = [name for name in shipped_models() if not name.endswith("-mono")]
    return (
        *models,
        *(f"texture:{name}" for name in PROFILES if name not in LIKE_PAPER and "texture" in models),
        *PASSTHROUGH,
    )


def play_task(
    names: Sequence[str] = (),
    *,
    rounds: int = 1000,
    visits: int = VISITS,
    seed: int = 0,
    report: Callable[[str], None] = lambda name: None,
) -> list[TaskOutcome]:
    """Let the operator play rounds with each method.

    ``names`` are of :func:`task_methods`, all by default, or ``FILE.onnx`` for any other model. Raises `ConfigError` if
    a name is unknown.
    """
    allowed = task_methods()
    if unknown := [name for name in names if name not in allowed and not Path(name).is_file()]:
        hint = did_you_mean(unknown[0], allowed)
        raise ConfigError(f"no method {', '.join(unknown)}; there are {', '.join(allowed)}, and model files{hint}")
    report("rendering visits")
    sound = render_visits(visits=visits, seed=seed)
    outcomes = []
    for name in names or allowed:
        report(name)
        played = play_rounds(perceive_visits(sound, vibration_of(name)), rounds=rounds, seed=seed)
        found, both = (np.array([getattr(game, field) for game in played]) for field in ("found", "success"))
        p5, p50, p95 = np.quantile([game.duration for game in played], [0.05, 0.5, 0.95])
        times = f"{p50:.1f} ({p5:.1f}-{p95:.1f})"
        outcomes.append(TaskOutcome(name, _share(found), _share(both), times, float(both.mean()), float(p50)))
    return outcomes


def vibration_of(name: str) -> SoundToVibration:
    """Return the function from both microphones to the vibration: the live pipeline and oscillator, or a renderer."""
    if name in PASSTHROUGH:
        return lambda sound: PASSTHROUGH[name](FULL_DRIVE).render_whole(sound)
    model, _, profile = name.partition(":")
    return lambda sound: _render(sound, model, profile or "paper")


def _render(sound: FloatArray, model: str, profile: str) -> FloatArray:
    pipeline = open_pipeline(model, sample_rate=LIVE_SAMPLE_RATE, channels=2, profile=profile, limits=FULL_DRIVE)
    oscillator = Oscillator(FULL_DRIVE)
    out = np.zeros(len(sound), np.float32)
    for start in range(0, len(sound), BLOCK_SIZE):
        step = pipeline.push(AudioBlock(sound[start : start + BLOCK_SIZE], LIVE_SAMPLE_RATE, start))
        if step.command:
            oscillator.submit(step.command)
        oscillator.render(out[start : start + BLOCK_SIZE])
    return out


def _share(won: NDArray[np.bool_]) -> str:
    """Format a share with Wilson's interval (J. Am. Stat. Assoc. 22, 1927)."""
    z = {0.90: 1.645}[COVERAGE]
    share, count = float(won.mean()), len(won)
    middle = (share + z**2 / 2 / count) / (1 + z**2 / count)
    half = z * np.sqrt(share * (1 - share) / count + z**2 / 4 / count**2) / (1 + z**2 / count)
    return f"{share:.3f} ({middle - half:.2f}-{middle + half:.2f})"
