"""The bench test of a finished finger: a ball, a tap, a weight and the robot's motors,
as the contact microphone hears them.

What is expected was calculated for the printed finger on silicone of Shore 00-30; no
finger was measured.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import NDArray

from tactophone.core.types import FloatArray
from tactophone.signal.perception.calibration import Finding

WEIGHT = 0.1
"""Mass of what stands on the pad, in kg."""

PAD = 2e-3
"""Mass of pad, ring and disc, in kg: 0.8 and 0.5 g of plastic, and a disc of 0.5 g."""

STIFFNESS = 11.8e3
"""Stiffness of the bed in N/m: the drawn one, at a modulus of 0.12 MPa."""

STIFFNESS_RATIO = 1.6
"""How many times stiffer or softer than expected a bed may be; Shore 10 A is 2.2
times."""

FAINTEST_BALL_DBFS = -20.0
"""Highest peak of a ball's drop under which the gain is too low."""

LOUDEST_BALL_DBFS = -1.0
"""Highest peak of a ball's drop over which it clips, with the gain turned down for
it."""

DULLEST_BALL_DB = -5.0
"""A ball's level over 1.5 kHz less its level from 100 to 800 Hz, under which the disc
hears through air."""

BRIGHTEST_BALL_DB = 9.0
"""The same difference over which the input has no bass."""

MOTORS_DB = 6.0
"""Decibels by which motors may raise the level of silence; with the gain turned down
for a ball, that is faint."""

LEAST_HITS = 2
"""Blows that each step must hold."""

CLEAR_DB = 20.0
"""Decibels by which a blow stands over silence."""

STRUCK = ("ball", "tap", "weight")
"""Steps in which the pad is struck."""


@dataclass(frozen=True, slots=True)
class BenchStep:
    """A step of the bench test."""

    name: str
    seconds: float
    instruction: str


STEPS = (
    BenchStep(
        "silence",
        3.0,
        "Silence: the finger clamped, its pad up, touching nothing; contact gain "
        "turned down for a ball",
    ),
    BenchStep("motors", 3.0, "Motors: let the robot's motors run, touching nothing"),
    BenchStep(
        "ball",
        8.0,
        "Ball: drop a steel ball of 2 g (8 mm) on the pad from 50 mm, about once a "
        "second; peaks near -6 dBFS",
    ),
    BenchStep("tap", 4.0, "Tap: tap on the pad with a pencil, about once a second"),
    BenchStep(
        "weight",
        8.0,
        "Weight: stand 100 g on the pad and tap it from above with a pencil, about "
        "once a second",
    ),
)
"""The steps, in order."""


@dataclass(frozen=True, slots=True)
class BenchResult:
    """What the bench test measured, ``nan`` where nothing was heard, and what it found
    wrong."""

    ball_dbfs: float
    brightness_db: float
    tap_over_silence_db: float
    resonance_hz: float
    stiffness: float
    """Stiffness of the bed, in N/m."""
    motors_db: float
    findings: tuple[Finding, ...] = ()

    @property
    def passed(self) -> bool:
        return not any(finding.fatal for finding in self.findings)

    def rows(self) -> list[dict[str, str]]:
        """Return measured beside expected, for a table."""
        resonance = np.sqrt(STIFFNESS / (PAD + WEIGHT)) / (2 * np.pi)
        band = np.sqrt(STIFFNESS_RATIO)
        compliance = 1e6 / STIFFNESS
        lines = (
            (
                "ball, highest peak",
                f"{self.ball_dbfs:.1f} dBFS",
                f"{FAINTEST_BALL_DBFS:g} to {LOUDEST_BALL_DBFS:g} dBFS",
            ),
            (
                "ball, treble over bass",
                f"{self.brightness_db:+.1f} dB",
                f"{DULLEST_BALL_DB:+g} to {BRIGHTEST_BALL_DB:+g} dB",
            ),
            (
                "tap over silence",
                f"{self.tap_over_silence_db:.0f} dB",
                f"{CLEAR_DB:g} dB or more",
            ),
            (
                "resonance under 100 g",
                f"{self.resonance_hz:.0f} Hz",
                f"{resonance / band:.0f} to {resonance * band:.0f} Hz",
            ),
            (
                "compliance of the bed",
                f"{1e6 / self.stiffness:.0f} µm/N",
                f"{compliance / STIFFNESS_RATIO:.0f} to "
                f"{compliance * STIFFNESS_RATIO:.0f} µm/N",
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


def measure_bench(sounds: Mapping[str, FloatArray], rate: int) -> BenchResult:
    """Measure the contact channel of the sounds of `STEPS`, each float32 ``(samples,
    channels)``."""
    heard = {name: sound[:, 0].astype(np.float64) for name, sound in sounds.items()}
    silence = _level(heard["silence"])
    blows = {name: _hits(heard[name], silence, rate) for name in STRUCK}
    peaks = [20 * np.log10(np.abs(hit).max()) for hit in blows["ball"]]
    tap_levels = [_level(hit[: rate // 50]) for hit in blows["tap"]]
    resonance = _median([_resonance(hit, rate) for hit in blows["weight"]])
    measured = BenchResult(
        ball_dbfs=float(max(peaks, default=np.nan)),
        brightness_db=_median([_brightness(hit, rate) for hit in blows["ball"]]),
        tap_over_silence_db=max(tap_levels, default=np.nan) - silence,
        resonance_hz=resonance,
        stiffness=(2 * np.pi * resonance) ** 2 * (PAD + WEIGHT),
        motors_db=_level(heard["motors"]) - silence,
    )
    unheard = [_few(name) for name, hits in blows.items() if len(hits) < LEAST_HITS]
    return replace(measured, findings=(*unheard, *_faults(measured)))


def _median(values: Sequence[float]) -> float:
    return float(np.median(values)) if values else float("nan")


def _few(name: str) -> Finding:
    return Finding(
        f"no-{name}",
        f"{name}: fewer than {LEAST_HITS} blows were heard; check plug and gain, and "
        "repeat it",
    )


def _faults(found: BenchResult) -> Iterator[Finding]:
    """Yield what is wrong, in words; comparisons with ``nan`` are false."""
    if found.brightness_db < DULLEST_BALL_DB:
        yield Finding(
            "air-under-disc",
            f"the ball sounds dull ({found.brightness_db:+.1f} dB): air is under the "
            "disc, or its glue is thick; "
            "glue another disc on another pad",
        )
    if found.brightness_db > BRIGHTEST_BALL_DB:
        yield Finding(
            "low-impedance",
            f"the ball has no bass ({found.brightness_db:+.1f} dB): switch the "
            "contact input to instrument (1 MOhm)",
        )
    if found.stiffness > STIFFNESS * STIFFNESS_RATIO:
        yield Finding(
            "stiff-bed",
            f"the bed gives {1e6 / found.stiffness:.0f} µm/N, too little: the "
            "silicone is too hard or too thin, or "
            "something hard joins pad and phalanx; pour it again with Shore 00-30",
        )
    if found.stiffness < STIFFNESS / STIFFNESS_RATIO:
        yield Finding(
            "soft-bed",
            f"the bed gives {1e6 / found.stiffness:.0f} µm/N, too much: it holds "
            "bubbles, has not set, or came loose",
        )
    if found.motors_db > MOTORS_DB:
        yield Finding(
            "motors",
            f"motors raise the level by {found.motors_db:.0f} dB: something hard "
            "joins pad and phalanx, or the cable "
            "runs beside a motor's",
        )
    if found.ball_dbfs > LOUDEST_BALL_DBFS:
        yield Finding(
            "loud-ball",
            "the ball clips: turn the contact gain down, and repeat the test",
        )
    if found.ball_dbfs < FAINTEST_BALL_DBFS:
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
    blow began in the 0.3 s before."""
    size = rate // 500
    length = 3 * rate // 10
    powers = np.mean(sound[: len(sound) // size * size].reshape(-1, size) ** 2, axis=1)
    loud = np.flatnonzero(10 * np.log10(np.maximum(powers, 1e-14)) > silence + CLEAR_DB)
    starts: list[int] = []
    for cell in loud:
        start = int(cell) * size
        rings_still = bool(starts) and start - starts[-1] < length
        whole = start + length <= len(sound)
        if whole and not rings_still:
            starts.append(start)
    return [sound[start : start + length] for start in starts]


def _brightness(hit: NDArray[np.float64], rate: int) -> float:
    """Return the level over 1.5 kHz less the level from 100 to 800 Hz, over 40 ms, in
    dB."""
    power = np.abs(np.fft.rfft(hit[: rate // 25])) ** 2
    frequency = np.fft.rfftfreq(rate // 25, 1 / rate)
    treble = power[(frequency > 1500) & (frequency < 12_000)].sum()
    bass = power[(frequency > 100) & (frequency < 800)].sum()
    return float(10 * np.log10(max(treble, 1e-14) / max(bass, 1e-14)))


def _resonance(hit: NDArray[np.float64], rate: int) -> float:
    """Return the frequency in Hz at which a blow rings, from 20 to 400 Hz; the blow
    itself is left out."""
    ringing = hit[rate // 100 :]
    fading = np.hanning(2 * len(ringing))[len(ringing) :]
    power = np.abs(np.fft.rfft(ringing * fading, 8 * len(ringing))) ** 2
    frequency = np.fft.rfftfreq(8 * len(ringing), 1 / rate)
    band = (frequency >= 20) & (frequency <= 400)
    return float(frequency[band][np.argmax(power[band])])
