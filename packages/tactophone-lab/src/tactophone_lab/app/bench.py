"""``tactophone bench``: the sounds of the bench test, recorded or simulated, and what
they say of the finger."""

from collections.abc import Callable

from tactophone.app.check import CHECKED_OBJECT, Step, record_act
from tactophone.app.sources import AudioInput, SimulatedAct
from tactophone.core.settings import Settings
from tactophone.core.types import LIVE_SAMPLE_RATE, ignore
from tactophone_lab.measurement.finger_bench import (
    PAD,
    STEPS,
    WEIGHT,
    BenchResult,
    measure_bench,
)


def run_bench(
    settings: Settings,
    *,
    step: Step = record_act,
    begin: Callable[[int, AudioInput], None] = ignore,
    weight: float = WEIGHT,
    pad: float = PAD,
) -> BenchResult:
    """Record the steps of the bench test and measure them.

    ``weight`` and ``pad`` are the masses in kg of what hangs on the nose, and of pad,
    ring and disc, as weighed.

    ``begin`` is called before the first step, with its number. A simulated finger is
    not asked for anything: its sounds are rendered.
    """
    if settings.capture.source == "finger":
        from tactophone_lab.simulation.built_finger import BuiltFinger, bench_sounds

        seed = settings.simulation.seed
        sounds = bench_sounds(BuiltFinger(), weight=WEIGHT, seed=seed)
        return measure_bench(sounds, LIVE_SAMPLE_RATE, weight=weight, pad=pad)
    with AudioInput(settings, CHECKED_OBJECT) as audio:
        begin(1, audio)
        blocks = iter(audio)
        sounds = {
            each.name: step(
                audio, blocks, SimulatedAct("rest", each.seconds), each.instruction
            )
            for each in STEPS
        }
        return measure_bench(sounds, audio.source.sample_rate, weight=weight, pad=pad)
