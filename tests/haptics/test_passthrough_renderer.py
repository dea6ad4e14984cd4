import math
from collections.abc import Callable

import numpy as np
import pytest

from tactophone.haptics import PASSTHROUGH, GateProfile, Limits, PassthroughRenderer
from tactophone.types import FloatArray, HapticCommand, Prediction, Touch
from tests.sounds import tone

RATE = 48_000
OPEN, CLOSED = HapticCommand(1.0, 35.0, 0.0), HapticCommand(0.0, 35.0, 0.0)


def endless(sound: FloatArray) -> Callable[[int], FloatArray]:
    """Give a sound piece by piece, over and over."""
    place = 0

    def pull(size: int) -> FloatArray:
        nonlocal place
        place += size
        return np.take(sound, range(place - size, place), axis=0, mode="wrap")

    return pull


def relay(
    name: str = "direct", *, limits: Limits | None = None, sound: FloatArray | None = None
) -> PassthroughRenderer:
    return PassthroughRenderer(PASSTHROUGH[name](None), endless(tone(200) if sound is None else sound), limits)


def felt(one: PassthroughRenderer, command: HapticCommand | None, duration: float, *, period: int = 128) -> FloatArray:
    """Render period by period, the command given afresh each time; ``None``: no command comes."""
    out = np.full(round(duration * RATE), np.nan, np.float32)
    for start in range(0, len(out), period):
        if command:
            one.submit(command)
        one.render(out[start : start + period])
    return out


@pytest.mark.parametrize("name", PASSTHROUGH)
def test_sound_passes_while_a_command_opens_it(name: str) -> None:
    wave = felt(relay(name), OPEN, 0.5)
    assert np.isfinite(wave).all()
    assert np.abs(wave).max() > 0.3


def test_what_passes_is_what_the_sounding_makes() -> None:
    one, sound = relay(), tone(200)
    expected = PASSTHROUGH["direct"](None).render_whole(sound)
    delay = round((one.latency - PASSTHROUGH["direct"](None).latency) * RATE)
    wave = felt(one, OPEN, 0.5)
    np.testing.assert_allclose(wave[9600:24_000], expected[9600 - delay : 24_000 - delay], atol=1e-4)


@pytest.mark.parametrize("periods", [(128, 128), (96, 160), (1, 479)])
def test_periods_that_vary_lose_no_sound(periods: tuple[int, int]) -> None:
    one, wave = relay(), []
    for number in range(200):
        one.submit(OPEN)
        out = np.empty(periods[number % 2], np.float32)
        one.render(out)
        wave.append(out)
    spectrum = np.abs(np.fft.rfft(np.concatenate(wave)[4800 : 4800 + 9600] * np.hanning(9600)))
    assert spectrum.argmax() * RATE / 9600 == pytest.approx(200)
    # Between the tone and its third harmonic, which the limiter makes: a gap in the sound would lie there.
    assert spectrum[50:110].max() < 0.01 * spectrum.max()


def test_closed_is_exact_silence() -> None:
    one = relay()
    felt(one, OPEN, 0.2)
    assert not felt(one, CLOSED, 0.2)[round(0.06 * RATE) :].any()


def test_stale_commands_are_silence_within_the_promise() -> None:
    one = relay()
    felt(one, OPEN, 0.3)
    wave = np.abs(felt(one, None, 0.3))
    assert wave[round(0.045 * RATE) :].max() < 0.2
    assert not wave[round(0.1 * RATE) :].any()
    assert one.faults == {"stale": 1}
    assert felt(one, OPEN, 0.1).any()


def test_stop_latches() -> None:
    one = relay()
    felt(one, OPEN, 0.2)
    one.stop()
    assert one.stopped
    assert not felt(one, OPEN, 0.2)[round(0.06 * RATE) :].any()
    one.reset()
    assert not felt(one, OPEN, 0.1).any()
    one.release()
    assert felt(one, OPEN, 0.1).any()


@pytest.mark.parametrize("ceiling", [0.0, 0.3, 1.0])
def test_never_over_the_ceiling(ceiling: float) -> None:
    wave = felt(relay(limits=Limits(ceiling=ceiling)), HapticCommand(50.0, 60.0, 0.0), 0.3)
    assert np.abs(wave).max() <= np.float32(ceiling)


def test_a_ceiling_lowered_in_a_run_holds_at_once() -> None:
    one = relay()
    felt(one, OPEN, 0.2)
    one.limits = Limits(ceiling=0.1)
    assert np.abs(felt(one, OPEN, 0.1)).max() <= np.float32(0.1)


@pytest.mark.parametrize("garbage", [math.nan, math.inf])
def test_a_command_that_is_no_number_silences_and_is_counted(garbage: float) -> None:
    one = relay()
    felt(one, OPEN, 0.2)
    wave = felt(one, HapticCommand(garbage, 60.0, 0.0), 0.2)
    assert not wave[round(0.06 * RATE) :].any()
    assert one.faults["command"] > 0


def test_it_opens_and_closes_without_a_step() -> None:
    steady = np.abs(np.diff(felt(relay(), OPEN, 0.5))).max()
    one = relay()
    wave = np.concatenate([felt(one, command, 0.05) for command in (OPEN, CLOSED) * 5])
    assert np.abs(np.diff(wave)).max() <= steady + 1 / (Limits().settling * RATE)


def test_the_profile_opens_in_contact_alone() -> None:
    belief = Prediction((0.0, 1.0, 0.0), Touch.SMOOTH, 0.0, -20.0, start=0.0, end=0.256)
    assert GateProfile("direct").command(belief).amplitude == 1.0
    lifted = Prediction((1.0, 0.0, 0.0), Touch.NONE, 0.0, -90.0, start=0.0, end=0.256)
    assert GateProfile("direct").command(lifted).amplitude == 0.0
