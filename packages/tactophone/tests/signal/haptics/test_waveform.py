"""What the finger gets, whatever the controls, the sound and the settings, from every
profile."""

import math
from collections.abc import Iterator

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.strategies import DrawFn

from tactophone.core.types import (
    LIVE_SAMPLE_RATE,
    FloatArray,
    HapticCommand,
    Prediction,
    Profile,
    Touch,
)
from tactophone.signal.haptics.limits import Limits
from tactophone.signal.haptics.oscillator import RAMP, Oscillator, Renderer
from tactophone.signal.haptics.passthrough import (
    GateProfile,
    PassthroughRenderer,
)
from tactophone.signal.haptics.profiles import PROFILES, open_profile
from tests.passthroughs import ALL_PASSTHROUGHS

PERIOD = 480
NAMES = (*PROFILES, *ALL_PASSTHROUGHS)
WINDOW = 0.1
"""Seconds over which a mean is a push."""

SETTLED = 10
"""Periods, 100 ms, after which a stop or a lower ceiling holds to the bit."""

_time = np.arange(2 * LIVE_SAMPLE_RATE) / LIVE_SAMPLE_RATE


def sound(kind: str, frequency: float, level: float) -> FloatArray:
    turns = (_time * frequency) % 1
    made = {
        "pulses": (turns < 0.05).astype(float),
        "step": (_time > 0.3).astype(float),
        "constant": np.ones_like(_time),
        "saw": 2 * turns - 1,
        "square": np.sign(turns - 0.3),
        "sine": np.sin(2 * np.pi * turns),
        "20 kHz": np.sin(2 * np.pi * 20_000 * _time),
        "NaN": np.where(np.arange(len(_time)) % 7, np.sin(2 * np.pi * turns), np.nan),
        "infinite": np.full_like(_time, np.inf),
        "noise": np.random.default_rng(int(frequency)).normal(size=len(_time)),
    }[kind]
    return np.asarray(level * made, np.float32)


KINDS = (
    "pulses",
    "step",
    "constant",
    "saw",
    "square",
    "sine",
    "20 kHz",
    "NaN",
    "infinite",
    "noise",
)

any_number = st.floats(0, 1) | st.sampled_from(
    [math.nan, math.inf, -math.inf, -1.0, 2.0, 1e30]
)


@st.composite
def limits(draw: DrawFn) -> Limits:
    lowest = draw(st.sampled_from([20.0, 35.0, 60.0]))
    return Limits(
        ceiling=draw(st.floats(0, 1)),
        lowest=lowest,
        highest=draw(st.sampled_from([250.0, 400.0, 1000.0])),
    )


def opened(name: str, bounds: Limits, heard: FloatArray) -> tuple[Renderer, Profile]:
    if name in PROFILES:
        return Oscillator(bounds), open_profile(name)
    place = iter(range(0, len(heard), 1))

    def pull(size: int) -> FloatArray:
        begin = next(place)
        for _ in range(size - 1):
            next(place, None)
        part = np.zeros(size, np.float32)
        found = heard[begin : begin + size]
        part[: len(found)] = found
        return np.stack([part, part], axis=1)

    made = ALL_PASSTHROUGHS[name](
        Limits(ceiling=1.0, lowest=bounds.lowest, highest=bounds.highest)
    )
    return PassthroughRenderer(made, pull, bounds), GateProfile(name)


def bound_of_step(bounds: Limits) -> float:
    """The steepest sine at the machine's ceiling, and the ramp of its amplitude."""
    return (
        bounds.machine
        * (
            2 * math.pi * bounds.highest / LIVE_SAMPLE_RATE
            + 1 / (RAMP * LIVE_SAMPLE_RATE)
        )
        + 1e-4
    )


def periods(
    renderer: Renderer, profile: Profile, count: int, touch: Touch, roughness: float
) -> Iterator[FloatArray]:
    for _ in range(count):
        predicted = Prediction(
            (0.0, 1 - roughness, roughness), touch, roughness, -20.0, 0.0, 0.0
        )
        command = profile.command(predicted)
        scale = renderer.limits.ceiling if command.amplitude > 0 else 0.0
        renderer.submit(
            HapticCommand(min(1.0, command.amplitude) * scale, command.frequency, 0.0)
        )
        out = np.empty(PERIOD, np.float32)
        renderer.render(out)
        yield out


@pytest.mark.slow
@settings(max_examples=80, deadline=None)
@given(
    st.data(),
    st.sampled_from(NAMES),
    limits(),
    st.sampled_from(KINDS),
    st.floats(20, 2000),
    st.floats(0, 1),
)
def test_no_control_no_sound_and_no_setting_clicks_pushes_or_passes_the_ceiling(
    data: st.DataObject,
    name: str,
    bounds: Limits,
    kind: str,
    frequency: float,
    level: float,
) -> None:
    renderer, profile = opened(name, bounds, sound(kind, frequency, level))
    machine = bounds.ceiling
    wave = [np.zeros(1, np.float32)]
    quiet = 0
    lowered = 0
    for _ in range(data.draw(st.integers(1, 12))):
        control = data.draw(
            st.sampled_from(
                ("command", "ceiling", "stop", "release", "nonsense", "silence")
            )
        )
        if control == "ceiling":
            bounds.ceiling, lowered = data.draw(st.floats(0, machine)), 0
        elif control == "stop":
            renderer.stop()
        elif control == "release":
            renderer.release()
        for _ in range(data.draw(st.integers(1, 14))):
            if control == "nonsense":
                renderer.submit(
                    HapticCommand(data.draw(any_number), data.draw(any_number), 0.0)
                )
                out = np.empty(PERIOD, np.float32)
                renderer.render(out)
            elif control == "silence":
                out = np.empty(PERIOD, np.float32)
                renderer.render(out)
            else:
                touch = data.draw(st.sampled_from(list(Touch)))
                (out,) = periods(
                    renderer, profile, 1, touch, data.draw(st.floats(0, 1))
                )
            quiet, lowered = (
                quiet + 1 if renderer.stopped or control == "silence" else 0,
                lowered + 1,
            )
            assert quiet <= SETTLED or not out.any()
            assert (
                lowered <= SETTLED
                or np.abs(out).max() <= bounds.ceiling * (1 + 1e-3) + 1e-6
            )
            wave.append(out)
    whole = np.concatenate(wave)
    assert np.isfinite(whole).all()
    assert np.abs(whole).max() <= machine * (1 + 1e-6)
    assert np.abs(np.diff(whole)).max() <= bound_of_step(bounds)


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("kind", KINDS)
def test_a_sound_of_one_sign_is_no_constant_force(name: str, kind: str) -> None:
    for frequency in (45.0, 100.0, 400.0):
        bounds = Limits(ceiling=0.5)
        renderer, profile = opened(name, bounds, sound(kind, frequency, 1.0))
        wave = np.concatenate(list(periods(renderer, profile, 80, Touch.ROUGH, 0.7)))
        # Weighted by a Hann window whose middle half is 100 ms: whole periods of 35 Hz
        # do not fit into 100 ms.
        window = np.hanning(LIVE_SAMPLE_RATE // 5)
        for begin in range(LIVE_SAMPLE_RATE * 2 // 5, len(wave) - len(window), 2400):
            assert (
                abs(np.average(wave[begin : begin + len(window)], weights=window))
                <= 0.01
            )
        # Without a window the sine of a profile keeps to 0.01 too, from its beginning;
        # the sound itself has no more than half a period of a sine at the lower end of
        # the band: cut to 0.01, it would lose all under 159 Hz.
        bound = (
            0.01
            if name in PROFILES
            else bounds.ceiling / (math.pi * bounds.lowest * WINDOW)
        )
        assert worst_mean(wave) <= bound


@pytest.mark.slow
@settings(max_examples=40, deadline=None)
@given(
    st.sampled_from(sorted(ALL_PASSTHROUGHS)),
    limits(),
    st.sampled_from(KINDS),
    st.floats(20, 2000),
    st.floats(0, 1),
)
def test_no_sound_pushes_longer_than_half_a_period_of_the_lowest_sine(
    name: str, bounds: Limits, kind: str, frequency: float, level: float
) -> None:
    renderer, profile = opened(name, bounds, sound(kind, frequency, level))
    wave = np.concatenate(list(periods(renderer, profile, 60, Touch.ROUGH, 0.7)))
    assert (
        worst_mean(wave) <= bounds.ceiling / (math.pi * bounds.lowest * WINDOW) + 1e-3
    )


def worst_mean(wave: FloatArray) -> float:
    """The greatest mean over any 100 ms."""
    size = round(WINDOW * LIVE_SAMPLE_RATE)
    total = np.concatenate([[0.0], np.cumsum(wave, dtype=float)])
    return float(np.abs(total[size:] - total[:-size]).max()) / size
