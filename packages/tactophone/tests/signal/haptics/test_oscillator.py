import math

import numpy as np
import pytest

from tactophone.core.types import FloatArray, HapticCommand, Prediction, Touch
from tactophone.signal.haptics.limits import Limits
from tactophone.signal.haptics.oscillator import RAMP, Oscillator
from tactophone.signal.haptics.profiles import PaperProfile

RATE = 48_000
ROUGH = HapticCommand(1.0, 60.0, 0.0)
SMOOTH = HapticCommand(10 ** (-25 / 20), 120.0, 0.0)
NONE = HapticCommand(0.0, 60.0, 0.0)


def full_drive() -> Oscillator:
    return Oscillator(Limits(ceiling=1.0))


def rendered(oscillator: Oscillator, size: int) -> FloatArray:
    out = np.full(size, np.nan, np.float32)
    oscillator.render(out)
    return out


def held(
    oscillator: Oscillator, command: HapticCommand, duration: float, *, hop: int = 512
) -> FloatArray:
    """Give the same command at every hop, as a detector would."""
    waves = []
    for _ in range(round(duration * RATE / hop)):
        oscillator.submit(command)
        waves.append(rendered(oscillator, hop))
    return np.concatenate(waves)


def peak(wave: FloatArray) -> tuple[float, float]:
    """Frequency and level (dBFS) of the strongest line; its bins are 0.02 Hz apart, and
    a Hann window's scallop nil."""
    shape = np.hanning(len(wave))
    spectrum = np.abs(np.fft.rfft(wave * shape, 50 * RATE)) / shape.sum() * 2
    best = int(spectrum.argmax())
    return best / 50, 20 * math.log10(spectrum[best])


@pytest.mark.parametrize(
    ("touch", "roughness", "frequency", "level_dbfs"),
    [
        (Touch.ROUGH, 1.0, 60.0, 0.0),
        (Touch.SMOOTH, 0.0, 120.0, -25.0),
        (Touch.ROUGH, 0.5, 84.85, -12.5),
    ],
)
def test_the_papers_stimuli_by_their_spectrum(
    touch: Touch, roughness: float, frequency: float, level_dbfs: float
) -> None:
    command = PaperProfile().command(
        Prediction((0, 1 - roughness, roughness), touch, roughness, -20.0, 0.0, 0.256)
    )
    wave = held(full_drive(), command, 2.2)[RATE // 10 :]
    found, level = peak(wave)
    assert found == pytest.approx(frequency, abs=0.5)
    assert level == pytest.approx(level_dbfs, abs=0.2)


def test_no_contact_is_exact_silence() -> None:
    oscillator = full_drive()
    held(oscillator, ROUGH, 0.5)
    wave = held(oscillator, NONE, 0.2)
    assert not wave[round(0.06 * RATE) :].any()


@pytest.mark.parametrize("size", [1, 17, 480, 509, 4096])
def test_any_block_size_gives_the_same_bits(size: int) -> None:
    commands = {0: ROUGH, 700: SMOOTH, 1500: NONE, 1700: ROUGH, 9000: SMOOTH}

    def run(step: int) -> FloatArray:
        oscillator, wave = full_drive(), []
        for start, end in zip(commands, [*list(commands)[1:], 16_000], strict=True):
            oscillator.submit(commands[start])
            wave += [
                rendered(oscillator, min(step, end - at))
                for at in range(start, end, step)
            ]
        return np.concatenate(wave)

    np.testing.assert_array_equal(run(size), run(16_000))


def test_the_waveform_never_jumps() -> None:
    rng = np.random.default_rng(0)
    oscillator = full_drive()
    wave = np.concatenate(
        [
            held(
                oscillator,
                HapticCommand(*rng.uniform([-1, 0], [3, 3000]), 0.0),
                0.003,
                hop=int(rng.integers(1, 144)),
            )
            for _ in range(200)
        ]
    )
    steepest = 2 * np.pi * Limits().highest / RATE + 1 / (RAMP * RATE)
    assert np.abs(np.diff(wave)).max() <= steepest
    assert np.abs(wave).max() <= 1


def test_a_change_keeps_the_phase() -> None:
    oscillator = full_drive()
    before = held(oscillator, ROUGH, 0.2)
    after = held(oscillator, HapticCommand(1.0, 120.0, 0.0), 0.1)
    joined = np.concatenate([before[-2:], after[:2]])
    assert np.abs(np.diff(joined, n=2)).max() < 1e-3


@pytest.mark.parametrize("ceiling", [0.0, 0.3, 1.0])
def test_never_over_the_ceiling(ceiling: float) -> None:
    wave = held(
        Oscillator(Limits(ceiling=ceiling)), HapticCommand(50.0, 60.0, 0.0), 0.5
    )
    assert np.abs(wave).max() <= np.float32(ceiling)
    assert np.abs(wave).max() == pytest.approx(ceiling, abs=1e-3)


def test_the_default_ceiling_is_half_of_full_drive() -> None:
    assert np.abs(held(Oscillator(), ROUGH, 0.5)).max() == pytest.approx(0.5, abs=1e-3)


def test_a_ceiling_lowered_in_a_run_holds_at_once() -> None:
    oscillator = full_drive()
    held(oscillator, ROUGH, 0.2)
    oscillator.limits = Limits(ceiling=0.2)
    assert np.abs(rendered(oscillator, 1024)).max() <= np.float32(0.2)


def test_a_stale_command_fades_within_the_promise() -> None:
    oscillator = full_drive()
    held(oscillator, ROUGH, 0.3)
    oscillator.submit(ROUGH)
    wave = np.abs(np.concatenate([rendered(oscillator, 512) for _ in range(20)]))
    cycle = RATE // 60
    at_40 = round(0.040 * RATE)
    assert wave[at_40 : at_40 + cycle].max() < 0.8
    assert not wave[round(0.1 * RATE) :].any()
    assert oscillator.faults == {"stale": 1}


def test_after_a_fade_a_fresh_command_vibrates_again() -> None:
    oscillator = full_drive()
    held(oscillator, ROUGH, 0.1)
    rendered(oscillator, RATE)
    assert np.abs(held(oscillator, ROUGH, 0.1)).max() > 0.9


def test_rest_is_never_stale() -> None:
    oscillator = full_drive()
    assert not rendered(oscillator, RATE).any()
    assert not oscillator.faults


@pytest.mark.parametrize("garbage", [math.nan, math.inf, -math.inf])
def test_a_command_that_is_no_number_silences_and_is_counted(garbage: float) -> None:
    oscillator = full_drive()
    held(oscillator, ROUGH, 0.2)
    wave = held(oscillator, HapticCommand(garbage, 60.0, 0.0), 0.1)
    assert np.isfinite(wave).all()
    assert not wave[RATE // 20 :].any()
    assert oscillator.faults["command"] == 9


def test_stop_latches() -> None:
    oscillator = full_drive()
    held(oscillator, ROUGH, 0.2)
    oscillator.stop()
    assert not held(oscillator, ROUGH, 0.2)[round(0.05 * RATE) :].any()
    oscillator.reset()
    assert not held(oscillator, ROUGH, 0.1).any()
    oscillator.release()
    assert held(oscillator, ROUGH, 0.1).any()


def test_the_first_sample_answers_as_declared() -> None:
    oscillator = full_drive()
    rendered(oscillator, 100)
    oscillator.submit(ROUGH)
    assert np.flatnonzero(rendered(oscillator, 100))[0] == round(
        oscillator.latency * RATE
    )


def test_reset_equals_new() -> None:
    oscillator = full_drive()
    held(oscillator, SMOOTH, 0.1)
    oscillator.reset()
    np.testing.assert_array_equal(
        held(oscillator, ROUGH, 0.1), held(full_drive(), ROUGH, 0.1)
    )


def test_a_ceiling_that_changes_does_not_refresh_a_command() -> None:
    oscillator = full_drive()
    oscillator.submit(ROUGH)
    wave = []
    for ceiling in np.linspace(0.9, 0.8, 30):
        wave.append(rendered(oscillator, 240))
        oscillator.limits.ceiling = ceiling
    assert not np.concatenate(wave)[round(0.1 * RATE) :].any()


def test_nothing_that_changes_after_a_reset_starts_a_vibration() -> None:
    oscillator = full_drive()
    held(oscillator, ROUGH, 0.1)
    oscillator.reset()
    oscillator.limits.ceiling = 0.5
    assert not rendered(oscillator, 480).any()


def test_a_command_that_is_replaced_before_its_first_sample_leaves_no_trace() -> None:
    replaced, once = full_drive(), full_drive()
    for oscillator in (replaced, once):
        held(oscillator, ROUGH, 0.1)
    replaced.submit(HapticCommand(1.0, 1000.0, 0.0))
    rendered(replaced, 0)
    for oscillator in (replaced, once):
        oscillator.submit(SMOOTH)
    np.testing.assert_allclose(rendered(replaced, 480), rendered(once, 480), atol=1e-6)


def test_from_silence_a_vibration_begins_at_phase_0_and_at_its_own_frequency() -> None:
    oscillator = full_drive()
    held(oscillator, HapticCommand(1.0, 500.0, 0.0), 0.1)
    held(oscillator, NONE, 0.2)
    oscillator.submit(ROUGH)
    count = np.arange(1, 481)
    expected = (1 - np.exp(-count / (RAMP * RATE))) * np.sin(
        2 * np.pi * 60.0 * count / RATE
    )
    np.testing.assert_allclose(rendered(oscillator, 480), expected, atol=1e-6)


def test_what_was_rendered_is_known_to_be_silent_only_once_it_is() -> None:
    oscillator = full_drive()
    assert not oscillator.silent
    rendered(oscillator, 10)
    assert oscillator.silent
    held(oscillator, ROUGH, 0.02)
    assert not oscillator.silent
    held(oscillator, NONE, 0.1)
    assert oscillator.silent


def test_a_command_holds_for_35_ms_to_the_sample() -> None:
    alone, followed = full_drive(), full_drive()
    for oscillator in (alone, followed):
        held(oscillator, ROUGH, 0.1)
        oscillator.submit(ROUGH)
    begun = rendered(followed, 840)
    followed.submit(ROUGH)
    np.testing.assert_array_equal(
        rendered(alone, 1680), np.concatenate([begun, rendered(followed, 840)])
    )
    assert rendered(alone, 1)[0] != rendered(followed, 1)[0]
