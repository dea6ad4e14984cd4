import math
from collections.abc import Callable

import numpy as np
import pytest

from tactophone.core.types import FloatArray, HapticCommand, Prediction, Touch
from tactophone.signal.haptics.limits import Limits
from tactophone.signal.haptics.oscillator import RAMP
from tactophone.signal.haptics.passthrough import (
    GateProfile,
    PassthroughRenderer,
)
from tests.passthroughs import ALL_PASSTHROUGHS
from tests.sounds import tone

RATE = 48_000
FULL = Limits(ceiling=1.0)
OPEN, CLOSED = HapticCommand(1.0, 35.0, 0.0), HapticCommand(0.0, 35.0, 0.0)


def endless(sound: FloatArray) -> Callable[[int], FloatArray]:
    """Give a sound piece by piece, over and over."""
    place = 0

    def pull(size: int) -> FloatArray:
        nonlocal place
        place += size
        return np.take(sound, range(place - size, place), axis=0, mode="wrap")

    return pull


def opened(
    name: str = "direct",
    *,
    limits: Limits | None = None,
    sound: FloatArray | None = None,
) -> PassthroughRenderer:
    return PassthroughRenderer(
        ALL_PASSTHROUGHS[name](FULL),
        endless(tone(200) if sound is None else sound),
        limits or FULL,
    )


def rendered(
    renderer: PassthroughRenderer,
    command: HapticCommand | None,
    duration: float,
    *,
    period: int = 128,
) -> FloatArray:
    """Render period by period, submitting the command each time; ``None``: no
    command."""
    out = np.full(round(duration * RATE), np.nan, np.float32)
    for start in range(0, len(out), period):
        if command:
            renderer.submit(command)
        renderer.render(out[start : start + period])
    return out


@pytest.mark.parametrize("name", ALL_PASSTHROUGHS)
def test_sound_passes_while_a_command_opens_it(name: str) -> None:
    wave = rendered(opened(name), OPEN, 0.5)
    assert np.isfinite(wave).all()
    assert np.abs(wave).max() > 0.3


def test_what_passes_is_what_the_passthrough_makes() -> None:
    renderer, sound = opened(), tone(200)
    expected = ALL_PASSTHROUGHS["direct"](FULL).render_whole(sound)
    delay = round((renderer.latency - ALL_PASSTHROUGHS["direct"](FULL).latency) * RATE)
    wave = rendered(renderer, OPEN, 0.5)
    np.testing.assert_allclose(
        wave[9600:24_000], expected[9600 - delay : 24_000 - delay], atol=1e-4
    )


@pytest.mark.parametrize("periods", [(128, 128), (96, 160), (1, 479)])
def test_periods_that_vary_lose_no_sound(periods: tuple[int, int]) -> None:
    renderer, wave = opened(), []
    for number in range(200):
        renderer.submit(OPEN)
        out = np.empty(periods[number % 2], np.float32)
        renderer.render(out)
        wave.append(out)
    spectrum = np.abs(
        np.fft.rfft(np.concatenate(wave)[4800 : 4800 + 9600] * np.hanning(9600))
    )
    assert spectrum.argmax() * RATE / 9600 == pytest.approx(200)
    # Between the tone and its third harmonic, which the limiter makes: a gap in the
    # sound would lie there.
    assert spectrum[50:110].max() < 0.01 * spectrum.max()


def test_closed_is_exact_silence() -> None:
    renderer = opened()
    rendered(renderer, OPEN, 0.2)
    assert not rendered(renderer, CLOSED, 0.2)[round(0.06 * RATE) :].any()


def test_stale_commands_are_silence_within_the_promise() -> None:
    renderer = opened()
    rendered(renderer, OPEN, 0.3)
    wave = np.abs(rendered(renderer, None, 0.3))
    assert wave[round(0.045 * RATE) :].max() < 0.2
    assert not wave[round(0.1 * RATE) :].any()
    assert renderer.faults == {"stale": 1}
    assert rendered(renderer, OPEN, 0.1).any()


def test_stop_latches() -> None:
    renderer = opened()
    rendered(renderer, OPEN, 0.2)
    renderer.stop()
    assert renderer.stopped
    assert not rendered(renderer, OPEN, 0.2)[round(0.06 * RATE) :].any()
    renderer.reset()
    assert not rendered(renderer, OPEN, 0.1).any()
    renderer.release()
    assert rendered(renderer, OPEN, 0.1).any()


@pytest.mark.parametrize("ceiling", [0.0, 0.3, 1.0])
def test_never_over_the_ceiling(ceiling: float) -> None:
    wave = rendered(
        opened(limits=Limits(ceiling=ceiling)), HapticCommand(50.0, 60.0, 0.0), 0.3
    )
    assert np.abs(wave).max() <= np.float32(ceiling)


def test_a_ceiling_lowered_in_a_run_holds_at_once() -> None:
    renderer = opened()
    rendered(renderer, OPEN, 0.2)
    renderer.limits = Limits(ceiling=0.1)
    assert np.abs(rendered(renderer, OPEN, 0.1)).max() <= np.float32(0.1)


@pytest.mark.parametrize("garbage", [math.nan, math.inf])
def test_a_command_that_is_no_number_silences_and_is_counted(garbage: float) -> None:
    renderer = opened()
    rendered(renderer, OPEN, 0.2)
    wave = rendered(renderer, HapticCommand(garbage, 60.0, 0.0), 0.2)
    assert not wave[round(0.06 * RATE) :].any()
    assert renderer.faults["command"] > 0


def test_it_opens_and_closes_without_a_step() -> None:
    steady = np.abs(np.diff(rendered(opened(), OPEN, 0.5))).max()
    renderer = opened()
    wave = np.concatenate(
        [rendered(renderer, command, 0.05) for command in (OPEN, CLOSED) * 5]
    )
    assert np.abs(np.diff(wave)).max() <= steady + 1 / (RAMP * RATE)


def test_the_profile_opens_in_contact_alone() -> None:
    prediction = Prediction(
        (0.0, 1.0, 0.0), Touch.SMOOTH, 0.0, -20.0, start=0.0, end=0.256
    )
    assert GateProfile("direct").command(prediction).amplitude == 1.0
    lifted = Prediction((1.0, 0.0, 0.0), Touch.NONE, 0.0, -90.0, start=0.0, end=0.256)
    assert GateProfile("direct").command(lifted).amplitude == 0.0
