import math

import numpy as np
import pytest

from tactophone.core.types import AudioBlock
from tactophone.signal.perception.contact import (
    CLEAR_DB,
    Contact,
    ContactGate,
)
from tactophone.signal.perception.levels import LoudnessRule
from tactophone.signal.perception.noise_floor import (
    LOWEST_DBFS,
    SPREAD_DB,
    NoiseFloor,
    RecordingFloor,
    measure_floor,
)
from tests.sounds import ODD_SIZES, blocks, noise, tone

THRESHOLD_DBFS = -40.0


def changes_in(samples: np.ndarray, size: int = 480) -> list[Contact]:
    gate = ContactGate(THRESHOLD_DBFS, sample_rate=48_000)
    return [change for block in blocks(samples, size) for change in gate.push(block)]


def stroke(start: float, end: float, *, level_dbfs: float = -20.0) -> np.ndarray:
    samples = noise(level_dbfs=-80, duration=1.0, channels=1)
    samples[round(start * 48_000) : round(end * 48_000)] += noise(
        level_dbfs=level_dbfs, duration=end - start, channels=1
    )
    return samples


def touches(changes: list[Contact]) -> list[float]:
    return [change.time for change in changes if change.touching]


@pytest.mark.parametrize("size", ODD_SIZES)
def test_any_block_size_gives_the_same_changes(size: int) -> None:
    samples = stroke(0.3, 0.6)
    assert changes_in(samples, size) == changes_in(samples, len(samples))


def restless(rate: int) -> np.ndarray:
    """Noise with twenty bursts of any level and length, and samples that are
    invalid."""
    samples = noise(
        level_dbfs=THRESHOLD_DBFS - 8, duration=4 * rate / 48_000, channels=1
    )
    random = np.random.default_rng(1)
    for start in random.integers(rate, len(samples), 20):
        part = samples[start : start + random.integers(1, rate // 4)]
        part += random.normal(0, 10 ** (random.uniform(-60, -5) / 20), part.shape)
    samples[3 * rate : 3 * rate + 100] = np.nan
    return samples


@pytest.mark.slow
@pytest.mark.parametrize("bands", [False, True])
@pytest.mark.parametrize("rule", ["banded", "rms", "mean_absolute"])
@pytest.mark.parametrize("rate", [2_000, 16_000, 44_100, 48_000])
def test_any_block_size_gives_the_same_changes_while_the_threshold_follows(
    rate: int, rule: LoudnessRule, bands: bool
) -> None:
    samples = restless(rate)

    def reports(size: int) -> list[tuple[Contact, float]]:
        floor = NoiseFloor(-30, spread_db=SPREAD_DB[rule])
        gate = ContactGate(
            THRESHOLD_DBFS,
            sample_rate=rate,
            rule=rule,
            floor=floor,
            bands=bands,
            hold=0.1,
        )
        found = [
            each
            for block in blocks(samples, size, sample_rate=rate)
            for each in gate.push(block)
        ]
        return [(contact, contact.threshold_dbfs) for contact in found]

    found = reports(57)
    assert found == reports(len(samples)) == reports(701)
    assert {(contact.touching, contact.held) for contact, _ in found} == {
        (0, 0),
        (1, 0),
        (1, 1),
    }


def following_gate(
    threshold_dbfs: float = -38, *, bands: bool = True, rate: int = 48_000
) -> ContactGate:
    """A gate whose threshold follows the noise."""
    return ContactGate(
        threshold_dbfs,
        sample_rate=rate,
        rule="banded",
        floor=NoiseFloor(threshold_dbfs),
        bands=bands,
        hold=0.1,
    )


def following(
    samples: np.ndarray, *, bands: bool = True, rate: int = 48_000
) -> list[Contact]:
    gate = following_gate(bands=bands, rate=rate)
    return gate.push(AudioBlock(samples.astype(np.float32), rate))


def test_motion_that_raises_all_sound_a_little_is_no_touch() -> None:
    samples = noise(level_dbfs=-60, duration=4.0, channels=1)
    samples[2 * 48_000 :] *= 10 ** (3 / 20)
    by_level, by_bands = (
        np.mean(
            [
                each.touching
                for each in following(samples, bands=bands)
                if each.time > 2.1
            ]
        )
        for bands in (False, True)
    )
    assert by_level > 0.9
    assert by_bands < 0.2


def test_a_touch_is_known_at_once_though_the_bands_take_longer() -> None:
    samples = noise(level_dbfs=-60, duration=2.0, channels=1)
    samples[48_000:] += noise(level_dbfs=-35, duration=1.0, channels=1, seed=1)
    found = following(samples)
    first = next(each.time for each in found if each.touching)
    assert 1.0 < first < 1.003
    assert all(each.touching and not each.held for each in found if each.time > first)


def test_a_stroke_that_turned_is_not_held_until_the_bands_hear_it_again() -> None:
    samples = noise(level_dbfs=-60, duration=3.0, channels=1)
    for start, end in ((1.0, 1.5), (1.59, 2.1)):
        part = slice(int(start * 48_000), int(end * 48_000))
        samples[part] += noise(
            level_dbfs=-54, duration=end - start, channels=1, seed=1
        )[: part.stop - part.start]
    found = [each for each in following(samples) if 1.4 < each.time < 2.1]
    assert all(each.touching for each in found)
    held = [each.time for each in found if each.held]
    # The bands hear the first part for as long as their windows last.
    assert 1.5 < held[0] < 1.58
    assert 1.58 < held[-1] < 1.605


def test_an_assigned_threshold_turns_the_bands_off() -> None:
    samples = noise(level_dbfs=-60, duration=2.0, channels=1)
    samples[48_000:] += noise(level_dbfs=-58, duration=1.0, channels=1, seed=1)
    gate = following_gate()
    gate.threshold.dbfs = -70.0
    assert all(
        each.touching
        for each in gate.push(AudioBlock(samples, 48_000))
        if each.time > 0.1
    )


def test_a_recording_without_a_floor_is_contact_throughout() -> None:
    gate = following_gate()
    gate.begin(RecordingFloor(LOWEST_DBFS, math.nan, -20.0))
    samples = noise(level_dbfs=-40, duration=1.0, channels=1)
    assert all(
        each.touching
        for each in gate.push(AudioBlock(samples, 48_000))
        if each.time > 0.05
    )


@pytest.mark.parametrize("rule", ["banded", "rms", "mean_absolute"])
def test_a_long_block_at_a_low_rate_fits_the_steps(rule: LoudnessRule) -> None:
    samples = noise(level_dbfs=THRESHOLD_DBFS + 20, duration=1.0, channels=1)
    gate = ContactGate(THRESHOLD_DBFS, sample_rate=2_000, rule=rule)
    assert any(change.touching for change in gate.push(AudioBlock(samples, 2_000)))


def test_a_clear_touch_is_known_in_a_millisecond_and_its_end_in_35() -> None:
    times = touches(changes_in(stroke(0.3, 0.6)))
    assert 0.3 < times[0] <= 0.301
    assert times[-1] <= 0.635


def test_a_faint_touch_is_known_once_it_has_lasted() -> None:
    times = touches(changes_in(stroke(0.3, 0.6, level_dbfs=THRESHOLD_DBFS + 1)))
    assert 0.31 < times[0] <= 0.34


def test_noise_with_hum_and_motors_under_the_threshold_opens_nothing() -> None:
    motor = tone(35, amplitude=10 ** ((THRESHOLD_DBFS - 5) / 20) * 2**0.5, duration=10)
    assert not touches(
        changes_in(
            motor + noise(level_dbfs=THRESHOLD_DBFS - 8, duration=10, channels=1)
        )
    )


def test_a_click_is_a_touch_long_enough_to_be_perceived() -> None:
    samples = np.zeros((48_000, 1), np.float32)
    samples[24_000:24_048] = 10 ** ((THRESHOLD_DBFS + CLEAR_DB + 7) / 20)
    changes = [change for change in changes_in(samples, 48) if change.touching]
    assert changes[0].time == 0.501
    after = next(
        change
        for change in changes_in(samples, 48)
        if not change.touching and change.time > 0.501
    )
    assert 0.029 < after.time - 0.501 < 0.04


def test_a_turning_stroke_is_one_touch() -> None:
    samples = stroke(0.3, 0.6)
    samples[round(0.45 * 48_000) : round(0.47 * 48_000)] = 0
    assert all(
        change.touching for change in changes_in(samples) if 0.31 < change.time < 0.6
    )


def test_the_noise_that_a_threshold_was_measured_in_ends_a_touch() -> None:
    silence = noise(level_dbfs=-43, duration=3.0, channels=1)
    threshold = measure_floor(
        [AudioBlock(silence, 48_000)], sample_rate=48_000, rule="banded"
    ).threshold_dbfs
    silence[24_000:48_000] += noise(level_dbfs=-20, duration=0.5, channels=1)
    found = ContactGate(threshold, sample_rate=48_000, rule="banded", hold=0.1).push(
        AudioBlock(silence, 48_000)
    )
    assert [0.9 < change.time < 1.2 for change in found if not change.touching].count(
        True
    ) > 5
    assert not any(change.touching for change in found if change.time > 1.2)


@pytest.mark.parametrize("value", [np.nan, np.inf, 1e30])
def test_sound_that_turns_invalid_is_silence_to_the_gate(value: float) -> None:
    samples, silence = stroke(0.3, 0.6), stroke(0.3, 0.6)
    samples[round(0.31 * 48_000) :] = value
    silence[round(0.31 * 48_000) :] = 0
    assert changes_in(samples) == changes_in(silence)


@pytest.mark.parametrize(("level_dbfs", "touching"), [(-39.5, True), (-43.5, False)])
@pytest.mark.parametrize("rule", ["rms", "mean_absolute"])
def test_the_level_is_of_the_rule_at_hand(
    rule: LoudnessRule, level_dbfs: float, touching: bool
) -> None:
    gate = ContactGate(THRESHOLD_DBFS, sample_rate=48_000, rule=rule)
    # A square wave is as loud by either rule; of other sound they differ by some
    # decibels.
    square = np.full((4800, 1), 10 ** (level_dbfs / 20), np.float32)
    assert gate.push(AudioBlock(square, 48_000))[-1].touching == touching


def test_a_heartbeat_comes_every_ten_milliseconds() -> None:
    times = [change.time for change in changes_in(np.zeros((48_000, 1), np.float32))]
    assert np.diff(times) == pytest.approx(0.01)


def heard_over_a_bad_link(*, concealed: bool, size: int = 240) -> list[Contact]:
    """The room's noise in packets of 5 ms. Of each 40, 20 in a row are lost, and
    concealed by sound that fades; or the same without a loss."""
    gate = following_gate(-26.0)
    contacts = []
    # The link is good for the first second.
    for block in blocks(noise(level_dbfs=-60, duration=6.0), 240):
        packet = block.start // 240
        lost = concealed and packet >= 200 and packet % 40 < 20
        fading = 10 ** (-2 * (packet % 40) / 20) if lost else 1.0
        heard = AudioBlock(fading * block.samples, 48_000, block.start, concealed=lost)
        for start in range(0, heard.size, size):
            part = heard.part(start, min(heard.size, start + size))
            contacts += gate.push(part)
    return contacts


def test_concealment_teaches_no_floor_under_which_the_rooms_noise_is_contact() -> None:
    good = heard_over_a_bad_link(concealed=False)
    bad = heard_over_a_bad_link(concealed=True)
    assert not any(contact.touching for contact in good)
    assert not any(contact.touching for contact in bad)
    assert bad[-1].threshold_dbfs == pytest.approx(good[-1].threshold_dbfs, abs=1.0)


def test_concealment_is_left_out_of_the_floor_at_any_block_size() -> None:
    whole = heard_over_a_bad_link(concealed=True)
    parts = heard_over_a_bad_link(concealed=True, size=37)
    levels = [contact.threshold_dbfs for contact in whole]
    assert [contact.threshold_dbfs for contact in parts] == levels
    assert parts == whole
