"""The bench test of a finished finger: a ball, a tap, a weight and the robot's motors,
as the contact microphone hears.

    python hardware/bench.py --source jack python hardware/bench.py --source finger
    # a simulated one, for which nobody has to do anything

It exits with 1 if the finger is not built as expected. Expected figures are those of
the printed finger on silicone of Shore 00-30, by calculation; none was measured.
"""

import sys
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from functools import partial

import numpy as np
from numpy.typing import NDArray

from tactophone.app.check import CHECKED_OBJECT, record_act
from tactophone.app.sources import AudioInput, SimulatedAct
from tactophone.cli import console, options, output
from tactophone.cli.guide import GuideScreen, findings_in_words
from tactophone.core.errors import TactophoneError
from tactophone.core.settings import Settings
from tactophone.core.types import LIVE_SAMPLE_RATE, FloatArray, ignore
from tactophone.signal.perception.calibration import Finding
from tactophone_lab.app.setup import Step
from tactophone_lab.cli.setup import Steps

WEIGHT = 0.1
"""In kg, of what stands on the pad."""

PAD = 2e-3
"""In kg, of pad, ring and disc."""

STIFFNESS = 11.8e3
"""Of the bed, in N/m: `dimensions.py`, at a modulus of 0.12 MPa."""

STIFFNESS_RATIO = 1.6
"""Times stiffer or softer than expected that a bed may be; Shore 10 A is 2.2 times."""

BALL_DBFS = -20.0, -1.0
"""Highest peak of a ball's drop, with the gain turned down for it."""

BRIGHTNESS_DB = -5.0, 9.0
"""Expected of a ball's drop: level over 1.5 kHz less that from 100 to 800 Hz."""

MOTORS_DB = 6.0
"""By how much motors may raise the level of silence; with the gain turned down for a
ball, that is faint."""

LEAST_HITS = 2
CLEAR_DB = 20.0
"""A hit stands so far over silence."""

STEPS = (
    (
        "silence",
        3.0,
        "Silence: the finger clamped, its pad up, touching nothing; contact gain turned down for a ball",
    ),
    ("motors", 3.0, "Motors: let the robot's motors run, touching nothing"),
    (
        "ball",
        8.0,
        "Ball: drop a steel ball of 2 g (8 mm) on the pad from 50 mm, about once a second; peaks near -6 dBFS",
    ),
    ("tap", 4.0, "Tap: tap on the pad with a pencil, about once a second"),
    (
        "weight",
        8.0,
        "Weight: stand 100 g on the pad and tap it from above with a pencil, about once a second",
    ),
)
"""Name, seconds and instruction of each step."""


@dataclass(frozen=True, slots=True)
class BenchResult:
    """What the bench test measured, ``nan`` where nothing was heard, and what it found
    wrong."""

    ball_dbfs: float
    brightness_db: float
    tap_over_silence_db: float
    resonance_hz: float
    stiffness: float
    """Of the bed, in N/m."""
    motors_db: float
    findings: tuple[Finding, ...] = ()

    @property
    def passed(self) -> bool:
        return not any(finding.fatal for finding in self.findings)

    def rows(self) -> list[dict[str, str]]:
        """Return measured beside expected, for a table."""
        expected = np.sqrt(STIFFNESS / (PAD + WEIGHT)) / (2 * np.pi)
        band = np.sqrt(STIFFNESS_RATIO)
        lines = (
            (
                "ball, highest peak",
                f"{self.ball_dbfs:.1f} dBFS",
                f"{BALL_DBFS[0]:g} to {BALL_DBFS[1]:g} dBFS",
            ),
            (
                "ball, treble over bass",
                f"{self.brightness_db:+.1f} dB",
                f"{BRIGHTNESS_DB[0]:+g} to {BRIGHTNESS_DB[1]:+g} dB",
            ),
            (
                "tap over silence",
                f"{self.tap_over_silence_db:.0f} dB",
                f"{CLEAR_DB:g} dB or more",
            ),
            (
                "resonance under 100 g",
                f"{self.resonance_hz:.0f} Hz",
                f"{expected / band:.0f} to {expected * band:.0f} Hz",
            ),
            (
                "compliance of the bed",
                f"{1e6 / self.stiffness:.0f} µm/N",
                f"{1e6 / STIFFNESS / STIFFNESS_RATIO:.0f} to {1e6 / STIFFNESS * STIFFNESS_RATIO:.0f} µm/N",
            ),
            (
                "motors over silence",
                f"{self.motors_db:.1f} dB",
                f"{MOTORS_DB:g} dB or less",
            ),
        )
        return [
            {"test": test, "measured": found, "expected": wanted}
            for test, found, wanted in lines
        ]


def run_bench(
    settings: Settings,
    *,
    step: Step = record_act,
    begin: Callable[[AudioInput], None] = ignore,
) -> BenchResult:
    """Record the steps and measure them; the simulated finger's are rendered.
    ``begin``: when the source is open."""
    if settings.capture.source == "finger":
        from bench_sounds import BuiltFinger, bench_sounds  # beside this file

        sounds = bench_sounds(
            BuiltFinger(), weight=WEIGHT, seed=settings.simulation.seed
        )
        return measure_bench(sounds, LIVE_SAMPLE_RATE)
    with AudioInput(settings, CHECKED_OBJECT) as audio:
        begin(audio)
        blocks = iter(audio)
        sounds = {
            name: step(audio, blocks, SimulatedAct("rest", long), words)
            for name, long, words in STEPS
        }
        return measure_bench(sounds, audio.source.sample_rate)


def measure_bench(sounds: Mapping[str, FloatArray], rate: int) -> BenchResult:
    """Measure the contact channel of the sounds of `STEPS`, each float32 ``(samples,
    channels)``."""
    heard = {name: sound[:, 0].astype(np.float64) for name, sound in sounds.items()}
    silence = _level(heard["silence"])
    balls, taps, weights = (
        _hits(heard[name], silence, rate) for name in ("ball", "tap", "weight")
    )
    resonance = (
        float(np.median([_resonance(hit, rate) for hit in weights]))
        if weights
        else float("nan")
    )
    peaks = [20 * np.log10(np.abs(hit).max()) for hit in balls]
    measured = BenchResult(
        ball_dbfs=float(max(peaks, default=float("nan"))),
        brightness_db=float(np.median([_brightness(hit, rate) for hit in balls]))
        if balls
        else float("nan"),
        tap_over_silence_db=max(
            (_level(hit[: rate // 50]) - silence for hit in taps), default=float("nan")
        ),
        resonance_hz=resonance,
        stiffness=(2 * np.pi * resonance) ** 2 * (PAD + WEIGHT),
        motors_db=_level(heard["motors"]) - silence,
    )
    few = [
        name
        for name, hits in (("ball", balls), ("tap", taps), ("weight", weights))
        if len(hits) < LEAST_HITS
    ]
    findings = (*(_few(name) for name in few), *_faults(measured))
    return BenchResult(
        **{name: getattr(measured, name) for name in measured.__slots__}
        | {"findings": findings}
    )


def _few(name: str) -> Finding:
    return Finding(
        f"no-{name}",
        f"{name}: fewer than {LEAST_HITS} blows were heard; check plug and gain, and repeat it",
    )


def _faults(found: BenchResult) -> Iterator[Finding]:
    """Yield what is wrong, in words; comparisons with ``nan`` are false."""
    dullest, brightest = BRIGHTNESS_DB
    if found.brightness_db < dullest:
        yield Finding(
            "air-under-disc",
            f"the ball sounds dull ({found.brightness_db:+.1f} dB): air is under the disc, or its glue is thick; "
            "glue another disc on another pad",
        )
    if found.brightness_db > brightest:
        yield Finding(
            "low-impedance",
            f"the ball has no bass ({found.brightness_db:+.1f} dB): switch the contact input to instrument (1 MOhm)",
        )
    if found.stiffness > STIFFNESS * STIFFNESS_RATIO:
        yield Finding(
            "stiff-bed",
            f"the bed gives {1e6 / found.stiffness:.0f} µm/N, too little: the silicone is too hard or too thin, or "
            "something hard joins pad and phalanx; pour it again with Shore 00-30",
        )
    if found.stiffness < STIFFNESS / STIFFNESS_RATIO:
        yield Finding(
            "soft-bed",
            f"the bed gives {1e6 / found.stiffness:.0f} µm/N, too much: it holds bubbles, has not set, or came loose",
        )
    if found.motors_db > MOTORS_DB:
        yield Finding(
            "motors",
            f"motors raise the level by {found.motors_db:.0f} dB: something hard joins pad and phalanx, or the cable "
            "runs beside a motor's",
        )
    if found.ball_dbfs > BALL_DBFS[1]:
        yield Finding(
            "loud-ball",
            "the ball clips: turn the contact gain down, and repeat the test",
        )
    if found.ball_dbfs < BALL_DBFS[0]:
        yield Finding(
            "faint-ball",
            "the ball is faint: turn the contact gain up, and repeat the test",
            fatal=False,
        )


def _level(sound: NDArray[np.float64]) -> float:
    return float(10 * np.log10(max(float(np.mean(sound**2)), 1e-14)))


def _hits(
    sound: NDArray[np.float64], silence: float, rate: int
) -> list[NDArray[np.float64]]:
    """Return 0.3 s from each blow: where 2 ms stand `CLEAR_DB` over silence, and no
    blow was for 0.3 s."""
    size, length = rate // 500, 3 * rate // 10
    powers = np.mean(sound[: len(sound) // size * size].reshape(-1, size) ** 2, axis=1)
    loud = np.flatnonzero(10 * np.log10(np.maximum(powers, 1e-14)) > silence + CLEAR_DB)
    starts: list[int] = []
    for cell in loud:
        if (
            not starts or cell * size - starts[-1] >= length
        ) and cell * size + length <= len(sound):
            starts.append(int(cell) * size)
    return [sound[start : start + length] for start in starts]


def _brightness(hit: NDArray[np.float64], rate: int) -> float:
    """Return the level over 1.5 kHz less that from 100 to 800 Hz, over 40 ms, in dB."""
    power = np.abs(np.fft.rfft(hit[: rate // 25])) ** 2
    pitch = np.fft.rfftfreq(rate // 25, 1 / rate)
    treble, bass = (
        power[(pitch > 1500) & (pitch < 12_000)].sum(),
        power[(pitch > 100) & (pitch < 800)].sum(),
    )
    return float(10 * np.log10(max(treble, 1e-14) / max(bass, 1e-14)))


def _resonance(hit: NDArray[np.float64], rate: int) -> float:
    """Return the frequency in Hz at which a blow rings, from 20 to 400 Hz; the blow
    itself is left out."""
    ringing = (
        hit[rate // 100 :]
        * np.hanning(2 * len(hit[rate // 100 :]))[len(hit[rate // 100 :]) :]
    )
    power = np.abs(np.fft.rfft(ringing, 8 * len(ringing))) ** 2
    pitch = np.fft.rfftfreq(8 * len(ringing), 1 / rate)
    band = (pitch >= 20) & (pitch <= 400)
    return float(pitch[band][np.argmax(power[band])])


def main(words: list[str] | None = None) -> int:
    parser = options.Parser(description=__doc__)
    parser.add_argument(
        "--yes", action="store_true", help="start each step without a key press"
    )
    options.add_json(parser, "print the result as JSON")
    options.add_settings(parser, "setup")
    options.add_finger(parser)
    args = parser.parse_args(words)
    try:
        with console.single_keys() as has_keyboard, output.live_display() as live:
            steps = Steps(GuideScreen(live, has_keyboard), unattended=args.yes)
            found = run_bench(
                options.settings_of(args), step=steps, begin=partial(steps.begin, 1)
            )
    except TactophoneError as error:
        output.print_error(str(error))
        return 1
    values = {
        "passed": found.passed,
        "findings": [finding.message for finding in found.findings],
    }
    verdict = (
        "good: the finger is built as expected"
        if found.passed
        else "correct this, and test again"
    )
    shown: list[output.Part] = [
        found.rows(),
        *findings_in_words(found.findings),
        verdict,
    ]
    output.show(
        values | {row["test"]: row["measured"] for row in found.rows()},
        shown,
        as_json=args.json,
    )
    return 0 if found.passed else 1


if __name__ == "__main__":
    sys.exit(main())
