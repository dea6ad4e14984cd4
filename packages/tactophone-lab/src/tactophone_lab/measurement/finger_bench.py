"""The bench test of a finished finger: a ball, a tap, a weight and the robot's motors,
as both microphones hear them.

What is expected follows from data sheets, masses on a scale and the drawn shape, not
from the simulator's constants; no finger was measured. Three quantities need no
knowledge of the preamplifier's gain. A ball's known impulse calibrates the contact
channel. A blow and the ringing that it starts have the same impulse, so that their
ratio shows a high-pass. And the pad's resonance alone and under the weight differ by
their masses only, whatever the bed.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy import optimize, signal

from tactophone.core.types import FloatArray
from tactophone.signal.perception.calibration import Finding

WEIGHT = 0.1
"""Mass of yoke and washers on the pad, in kg."""

WEIGHT_TOLERANCE = 0.06
"""Share by which the ratio of both resonances may differ from what the masses give; the
weight may so differ by 12 %."""

PAD = 4.4e-3
"""Mass of pad, ring and disc, in kg: 0.8 g of plastic, 3.3 g of brass, a disc of 0.2 g
and glue. With a printed ring it is 1.6 g."""

STIFFNESS = 11.8e3
"""Stiffness of the bed in N/m: the drawn one, at a modulus of 0.12 MPa, Shore 00-30.
Its data sheet states 69 kPa at 100 % strain."""

STIFFNESS_RATIO = 1.6
"""How many times stiffer or softer than expected a bed may be; Shore 10 A is 2.2
times."""

DISC_CAPACITANCE = 10e-9
"""Farads of a piezo disc of 12 mm (8 to 20 nF)."""

HIGHEST_CORNER = 45.0
"""Hz over which the input takes away bass. An instrument input of 1 MOhm has 16; 160
kOhm across the disc have 100, which are measured as 62, as a blow lasts."""

LEAST_RESISTANCE = 1 / (2 * np.pi * HIGHEST_CORNER * DISC_CAPACITANCE)
"""Ohms across the disc at that corner: 354 kOhm."""

BALL_IMPULSE = 3.1e-3
"""N s of a steel ball of 8 mm, 2.1 g, that falls from 50 mm: ``m sqrt(2 g h) (1 + e)``
with a restitution e of 0.5 (0.3 to 0.7: 13 % either way)."""

FAINTEST_BALL_DBFS = -20.0
"""Highest peak of a ball's drop under which the gain is too low."""

LOUDEST_BALL_DBFS = -1.0
"""Highest peak of a ball's drop over which it clips, with the gain turned down for
it."""

DULLEST_BALL_DB = -5.0
"""A ball's level over 1.5 kHz less its level from 100 to 800 Hz, under which the disc
hears through air."""

UPSIDE_DOWN_DB = -22.0
"""The same difference under which the ball fell on the nail: the disc then hears it
through the bed, which takes away 12 dB an octave over the pad's resonance."""

BRIGHTEST_BALL_DB = 9.0
"""The same difference over which the input has no bass."""

LOOSE_DB = -40.0
"""Level over 2 kHz from 8 to 30 ms after a ball's blow, less that of the blow itself,
over which something rattles. Printed plastic has a Q of 20 at most: what rings at 2 kHz
has fallen by 22 dB after 8 ms, and little of a blow rings there."""

AIR_OVER_CONTACT_DB = -16.0
"""Level of a ball in the air channel less that in the contact channel, from 1 to 6
kHz, both knobs at the same mark. The pad's motion makes 1.9 mPa per m/s^2 at 2 cm (a
source of 5 cm^2), of its mass 0.42 Pa/N; with 7.9 mV/Pa of an SPW2430, and 40 mV/N of
the disc at half of the force, the ratio is 0.15."""

AIR_TOLERANCE_DB = 14.0
"""Decibels by which that level may differ: 9 for the disc's sensitivity, 5 for the
microphone's and its place. A board with an amplifier of 64 times is 36 dB louder."""

MOST_MOTORS = 6.4e-3
"""Newtons rms of contact to which motors may be equal. In the paper's authors' code
contact begins at a mean of 0.005 of full scale, 0.0063 rms, and full scale is 1 N."""

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
        "Silence: the finger clamped with its pad up, touching nothing; both gains "
        "turned down to the same mark, at which a ball peaks near -6 dBFS",
    ),
    BenchStep("motors", 3.0, "Motors: let the robot's motors run, touching nothing"),
    BenchStep(
        "ball",
        8.0,
        "Ball: drop a steel ball of 8 mm through the guide, from its upper edge, about "
        "once a second; peaks near -6 dBFS",
    ),
    BenchStep(
        "tap",
        4.0,
        "Tap: take the guide off and tap the nose with a pencil, about once a second",
    ),
    BenchStep(
        "weight",
        8.0,
        "Weight: stand the yoke with its washers on the nose and tap it from above "
        "with a pencil, about once a second",
    ),
)
"""The steps, in order."""


@dataclass(frozen=True, slots=True)
class BenchResult:
    """What the bench test measured, ``nan`` where nothing was heard, and what it found
    wrong."""

    ball_dbfs: float
    brightness_db: float
    rattle_db: float
    """Treble that is left after a ball's blow, less that of the blow."""
    air_over_contact_db: float
    tap_over_silence_db: float
    resonance_hz: float
    """Of the pad under the weight."""
    stiffness: float
    """Stiffness of the bed, in N/m."""
    resonance_ratio: float
    """Resonance of the pad alone over that under the weight."""
    corner_hz: float
    """High-pass corner of the contact channel."""
    motors: float
    """What motors add to silence, as newtons rms of contact."""
    weight: float = WEIGHT
    pad: float = PAD
    """`weight` and `pad`: masses in kg, as weighed."""
    findings: tuple[Finding, ...] = ()

    @property
    def expected_ratio(self) -> float:
        """Ratio of both resonances that the masses give."""
        return float(np.sqrt((self.weight + self.pad) / self.pad))

    @property
    def passed(self) -> bool:
        return not any(finding.fatal for finding in self.findings)

    def rows(self) -> list[dict[str, str]]:
        """Return measured beside expected, for a table."""
        resonance = np.sqrt(STIFFNESS / (self.pad + self.weight)) / (2 * np.pi)
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
                "ball, treble left after 8 ms",
                f"{self.rattle_db:.0f} dB",
                f"{LOOSE_DB:g} dB or less",
            ),
            (
                "ball, air over contact",
                f"{self.air_over_contact_db:+.0f} dB",
                f"{AIR_OVER_CONTACT_DB - AIR_TOLERANCE_DB:+g} to "
                f"{AIR_OVER_CONTACT_DB + AIR_TOLERANCE_DB:+g} dB",
            ),
            (
                "tap over silence",
                f"{self.tap_over_silence_db:.0f} dB",
                f"{CLEAR_DB:g} dB or more",
            ),
            (
                f"resonance under {1e3 * self.weight:g} g",
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
                "resonance of the pad alone over that",
                f"{self.resonance_ratio:.2f}",
                f"{self.expected_ratio * (1 - WEIGHT_TOLERANCE):.2f} to "
                f"{self.expected_ratio * (1 + WEIGHT_TOLERANCE):.2f}",
            ),
            (
                "corner of the contact input",
                f"{self.corner_hz:.0f} Hz",
                f"{HIGHEST_CORNER:g} Hz or less",
            ),
            (
                "motors, as a force of contact",
                f"{1e3 * self.motors:.1f} mN",
                f"{1e3 * MOST_MOTORS:g} mN or less",
            ),
        )
        return [
            {"test": test, "measured": found, "expected": wanted}
            for test, found, wanted in lines
        ]


def measure_bench(
    sounds: Mapping[str, FloatArray],
    rate: int,
    *,
    weight: float = WEIGHT,
    pad: float = PAD,
) -> BenchResult:
    """Measure the sounds of `STEPS`, each float32 ``(samples, channels)``; ``weight``
    and ``pad`` in kg, as weighed."""
    heard = {name: sound[:, 0].astype(np.float64) for name, sound in sounds.items()}
    silence = _level(heard["silence"])
    found = {name: _starts(heard[name], silence, rate) for name in STRUCK}
    blows = {name: _cut(heard[name], starts, rate) for name, starts in found.items()}
    peaks = [20 * np.log10(np.abs(hit).max()) for hit in blows["ball"]]
    tap_levels = [_level(hit[: rate // 50]) for hit in blows["tap"]]
    under_weight = [
        ring for hit in blows["weight"] if (ring := _ring(hit, rate, HEAVY))
    ]
    resonance = _median([ring.frequency for ring in under_weight])
    corner = _median([ring.corner for ring in under_weight])
    alone = [
        ring for hit in blows["tap"] if (ring := _ring(hit, rate, LIGHT, corner=corner))
    ]
    sensitivity = _median([_area(hit, rate) for hit in blows["ball"]]) / BALL_IMPULSE
    air = [
        _air_over_contact(contact, beside, rate)
        for contact, beside in zip(
            blows["ball"],
            _cut(sounds["ball"][:, -1].astype(np.float64), found["ball"], rate),
            strict=True,
        )
        if sounds["ball"].shape[1] > 1
    ]
    measured = BenchResult(
        ball_dbfs=float(max(peaks, default=np.nan)),
        brightness_db=_median([_brightness(hit, rate) for hit in blows["ball"]]),
        rattle_db=_median([_rattle(hit, rate) for hit in blows["ball"]]),
        air_over_contact_db=_median(air),
        tap_over_silence_db=max(tap_levels, default=np.nan) - silence,
        resonance_hz=resonance,
        stiffness=(2 * np.pi * resonance) ** 2 * (pad + weight),
        resonance_ratio=_median([ring.frequency for ring in alone]) / resonance,
        corner_hz=corner,
        motors=_added(heard["motors"], heard["silence"]) / sensitivity,
        weight=weight,
        pad=pad,
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
    if found.brightness_db < UPSIDE_DOWN_DB:
        # Nothing else can be measured through the bed.
        yield Finding(
            "upside-down",
            f"the ball sounds muffled ({found.brightness_db:+.0f} dB): it fell on the "
            "nail; clamp the finger with its pad up, and repeat the test",
        )
        return
    if found.rattle_db > LOOSE_DB:
        yield Finding(
            "loose-glue",
            f"{found.rattle_db:.0f} dB of treble are left 8 ms after a ball: the disc "
            "or the ring is loose and rattles; glue it again",
        )
        return
    if found.brightness_db < DULLEST_BALL_DB:
        yield Finding(
            "air-under-disc",
            f"the ball sounds dull ({found.brightness_db:+.1f} dB): air is under the "
            "disc, or its glue is thick; glue another disc on another pad",
        )
        return
    if found.corner_hz > HIGHEST_CORNER or found.brightness_db > BRIGHTEST_BALL_DB:
        yield Finding(
            "low-impedance",
            f"the contact channel has no bass (corner {found.corner_hz:.0f} Hz): less "
            f"than {1e-3 * LEAST_RESISTANCE:.0f} kOhm lie across the disc; switch the "
            "input to instrument (1 MOhm), and look for a resistor that does not "
            "belong there",
        )
        return
    difference_db = found.air_over_contact_db - AIR_OVER_CONTACT_DB
    if abs(difference_db) > AIR_TOLERANCE_DB:
        words = (
            "the board has an amplifier of its own, or the knobs stand at other marks"
            if difference_db > 0
            else "its port is covered or points the wrong way, it has no supply, or "
            "the knobs stand at other marks"
        )
        yield Finding(
            "board",
            f"the air microphone hears a ball {difference_db:+.0f} dB from what is "
            f"expected: {words}",
        )
    ratio = found.resonance_ratio / found.expected_ratio
    if abs(ratio - 1) > WEIGHT_TOLERANCE:
        mass = found.resonance_ratio**2 * found.pad - found.pad
        yield Finding(
            "weight",
            f"the weight acts as {1e3 * mass:.0f} g in place of "
            f"{1e3 * found.weight:.0f}: weigh yoke and washers, and pad with ring, and "
            "state both",
        )
        return
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
    if found.motors > MOST_MOTORS:
        yield Finding(
            "motors",
            f"motors sound like a contact of {1e3 * found.motors:.0f} mN: something "
            "hard joins pad and phalanx, or the cable runs beside a motor's",
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


def _starts(sound: NDArray[np.float64], silence: float, rate: int) -> list[int]:
    """Return where each blow begins: 2 ms stand `CLEAR_DB` over silence, and no blow
    began in the 0.3 s before."""
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
    return starts


def _cut(
    sound: NDArray[np.float64], starts: Sequence[int], rate: int
) -> list[NDArray[np.float64]]:
    """Return 0.3 s from each blow."""
    return [sound[start : start + 3 * rate // 10] for start in starts]


def _added(sound: NDArray[np.float64], silence: NDArray[np.float64]) -> float:
    """Return the rms by which a sound exceeds silence, as powers."""
    added = float(np.mean(sound**2)) - float(np.mean(silence**2))
    return float(np.sqrt(max(added, 0.0)))


def _blow(hit: NDArray[np.float64]) -> tuple[int, int]:
    """Return where the blow itself begins and ends: about its peak, over a fifth of
    it."""
    size = np.abs(hit)
    peak = int(size.argmax())
    low = size < 0.2 * size[peak]
    before, after = np.flatnonzero(low[:peak]), np.flatnonzero(low[peak:])
    begin = int(before[-1]) if before.size else 0
    return begin, peak + (int(after[0]) if after.size else 1)


def _area(hit: NDArray[np.float64], rate: int) -> float:
    """Return the blow's impulse, in full scale times seconds."""
    begin, end = _blow(hit)
    return float(abs(hit[begin:end].sum()) / rate)


class _Ring(NamedTuple):
    """What a blow started: undamped frequency in Hz, and the high-pass corner by which
    its strength falls short of the blow's impulse."""

    frequency: float
    corner: float


class _Listening(NamedTuple):
    """Which ringing is fitted: band in Hz, seconds after the blow from and to, and the
    loss to begin with."""

    low: float
    high: float
    begin: float
    end: float
    loss: float


HEAVY = _Listening(20.0, 200.0, 4e-3, 0.28, 0.05)
"""The pad under the weight."""

LIGHT = _Listening(100.0, 900.0, 0.5e-3, 0.02, 0.2)
"""The pad alone."""


def _ring(
    hit: NDArray[np.float64], rate: int, band: _Listening, *, corner: float = np.nan
) -> _Ring | None:
    """Fit a damped oscillation to what follows a blow; ``None`` if there is none.

    With ``corner``, what a high-pass of this corner in Hz adds to it is fitted too: it
    falls as ``exp(-2 pi corner t)``, and would be taken for another frequency.
    """
    begin, end = _blow(hit)
    middle = (begin + end) // 2
    first = end + round(band.begin * rate)
    last = min(middle + round(band.end * rate), len(hit))
    step = max(1, int(rate / (12 * band.high)))
    smooth = signal.sosfiltfilt(
        signal.butter(2, 4 * band.high, fs=rate, output="sos"), hit
    )
    sound = smooth[first:last:step]
    time = (np.arange(first, last, step) - middle) / rate
    if len(sound) < 16:
        return None

    def parts(values: NDArray[np.float64]) -> NDArray[np.float64]:
        omega, loss = 2 * np.pi * values[0], min(max(values[1], 0.0), 0.9)
        swing = omega * np.sqrt(1 - loss**2) * time
        fade = np.exp(-loss * omega * time)
        shapes = [fade * np.sin(swing), fade * np.cos(swing)]
        if np.isfinite(corner):
            shapes.append(np.exp(-2 * np.pi * corner * time))
        return np.column_stack(shapes)

    def missed(values: NDArray[np.float64]) -> float:
        shapes = parts(values)
        strength = np.linalg.lstsq(shapes, sound, rcond=None)[0]
        return float(np.square(sound - shapes @ strength).sum())

    grid = np.geomspace(band.low, band.high, 60)
    start = min(grid, key=lambda f: missed(np.array([f, band.loss])))
    fitted = optimize.minimize(
        missed, np.array([start, band.loss]), method="Nelder-Mead"
    ).x
    frequency = float(fitted[0])
    if not band.low < frequency < band.high:
        return None
    strength = np.linalg.lstsq(parts(fitted), sound, rcond=None)[0]
    impulse = _area(hit, rate)
    share = float(np.hypot(*strength[:2])) / (impulse * 2 * np.pi * frequency)
    corner = frequency * np.sqrt(max(1 / max(share, 1e-3) ** 2 - 1, 0.0))
    return _Ring(frequency, float(corner))


def _rattle(hit: NDArray[np.float64], rate: int) -> float:
    """Return the level over 2 kHz from 8 to 30 ms after a blow less that of its first 4
    ms, in dB."""
    high = signal.sosfilt(
        signal.butter(4, 2000, "highpass", fs=rate, output="sos"), hit
    )
    begin, _ = _blow(hit)
    blow = high[begin : begin + rate // 250]
    after = high[begin + rate // 125 : begin + 3 * rate // 100]
    return _level(after) - _level(blow)


def _air_over_contact(
    contact: NDArray[np.float64], air: NDArray[np.float64], rate: int
) -> float:
    """Return the level of the blow in the air channel less that in the contact channel,
    in dB, from 1 to 6 kHz, where the blow itself is heard."""
    band = signal.butter(2, (1000, 6000), "bandpass", fs=rate, output="sos")
    begin = max(0, _blow(contact)[0] - rate // 1000)
    first = slice(begin, begin + rate // 200)
    levels = [_level(signal.sosfilt(band, sound)[first]) for sound in (air, contact)]
    return levels[0] - levels[1]


def _brightness(hit: NDArray[np.float64], rate: int) -> float:
    """Return the level over 1.5 kHz less the level from 100 to 800 Hz, over 40 ms, in
    dB."""
    power = np.abs(np.fft.rfft(hit[: rate // 25])) ** 2
    frequency = np.fft.rfftfreq(rate // 25, 1 / rate)
    treble = power[(frequency > 1500) & (frequency < 12_000)].sum()
    bass = power[(frequency > 100) & (frequency < 800)].sum()
    return float(10 * np.log10(max(treble, 1e-14) / max(bass, 1e-14)))
