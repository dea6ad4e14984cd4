"""Sound that comes through the air is no touch, where both microphones are heard.

The pairs are made: contact hears the air's sound 20 dB quieter and dull, which is more
than any mounting lets through (`tactophone.signal.perception.airborne`).
"""

import numpy as np
import pytest
from scipy import signal

from tactophone.core.types import AudioBlock, FloatArray
from tactophone.signal.perception.contact import Contact, ContactGate
from tactophone.signal.perception.noise_floor import NoiseFloor
from tests.sounds import ODD_SIZES, blocks, noise

RATE = 48_000
SECONDS = 4.0
BEGINS = 1.0
"""When the sound in the air begins, in s."""


def syllables() -> FloatArray:
    """A voice: four syllables a second of a harmonic sound, each after a hiss."""
    time = np.arange(round(0.2 * RATE)) / RATE
    rng = np.random.default_rng(3)
    found = np.zeros(round(SECONDS * RATE))
    for start in np.arange(BEGINS, SECONDS - 0.25, 0.25):
        buzz = signal.sawtooth(2 * np.pi * rng.uniform(90, 220) * time)
        formant = signal.iirpeak(rng.uniform(300, 900), 4, RATE)
        vowel = signal.lfilter(*formant, buzz) * np.sin(np.pi * time / time[-1])
        hiss = 0.05 * rng.standard_normal(len(time)) * (time < 0.04)
        at = round(start * RATE)
        found[at : at + len(time)] += vowel / np.abs(vowel).max() + hiss
    return 0.3 * found


def beats() -> FloatArray:
    """Music: a kick and a snare in turn, every quarter of a second."""
    time = np.arange(round(0.25 * RATE)) / RATE
    rng = np.random.default_rng(4)
    kick = np.sin(2 * np.pi * 60 * time) * np.exp(-time / 0.08)
    snare = rng.standard_normal(len(time)) * np.exp(-time / 0.05)
    found = np.resize(np.append(kick, snare), round(SECONDS * RATE))
    found[: round(BEGINS * RATE)] = 0
    return 0.3 * found


def clap() -> FloatArray:
    """A single clap at 2 s."""
    found = np.zeros(round(SECONDS * RATE))
    time = np.arange(RATE // 2) / RATE
    burst = np.random.default_rng(5).standard_normal(len(time)) * np.exp(-time / 0.01)
    found[2 * RATE : 2 * RATE + len(time)] = 0.5 * burst
    return found


AIRBORNE = {"speech": syllables, "music": beats, "clap": clap}


def heard_by_both(sound: FloatArray) -> FloatArray:
    """The pair of a sound in the air, ``(samples, 2)``, over the noise of both
    microphones."""
    low = signal.butter(2, 800, "low", fs=RATE, output="sos")
    pair = np.column_stack((0.1 * signal.sosfilt(low, sound), sound))
    pair += noise(level_dbfs=-70, duration=SECONDS)
    return pair.astype(np.float32)


def touched(pair: FloatArray, begin: float, end: float) -> FloatArray:
    """A pair with a touch in it: -30 dBFS, and 10 dB less in the air."""
    pair = pair.copy()
    touch = noise(level_dbfs=-30, duration=end - begin, channels=1, seed=9)
    pair[round(begin * RATE) : round(end * RATE)] += touch * np.float32([1.0, 0.3])
    return pair


def gate(*, pair: bool = True) -> ContactGate:
    return ContactGate(
        -38,
        sample_rate=RATE,
        rule="banded",
        floor=NoiseFloor(-38),
        bands=True,
        pair=pair,
        hold=0.1,
    )


def contacts(
    samples: FloatArray, *, pair: bool = True, size: int = 480
) -> list[Contact]:
    followed = gate(pair=pair)
    return [each for block in blocks(samples, size) for each in followed.push(block)]


def share_of_contact(found: list[Contact]) -> float:
    """Share of the time from the sound's beginning on; the gate reports each hop."""
    late = [each.touching for each in found if each.time >= BEGINS]
    return sum(late) / len(late)


@pytest.mark.parametrize("name", AIRBORNE)
def test_what_comes_through_the_air_is_no_contact(name: str) -> None:
    pair = heard_by_both(AIRBORNE[name]())
    alone = share_of_contact(contacts(pair[:, :1]))
    assert alone > (0.03 if name == "clap" else 0.5)
    assert share_of_contact(contacts(pair)) == 0


@pytest.mark.parametrize("name", ["speech", "music"])
def test_a_touch_beside_it_is_felt_and_ends(name: str) -> None:
    sound = AIRBORNE[name]()
    found = contacts(touched(heard_by_both(sound), 2.0, 2.5))
    begins = next(each.time for each in found if each.touching)
    assert 2.0 < begins < 2.03
    assert all(each.touching for each in found if begins < each.time < 2.5)
    assert not any(each.touching for each in found if each.time > 2.7)


def begun(pair: FloatArray) -> FloatArray:
    """A pair of which the quiet beginning is cut off: the sound is there when the run
    begins, so that no noise is known."""
    return pair[round(BEGINS * RATE) :]


@pytest.mark.parametrize("name", ["speech", "music"])
def test_what_is_in_the_air_when_a_run_begins_is_no_contact(name: str) -> None:
    # So loud that what comes through is over the threshold before the noise is known.
    pair = begun(4 * heard_by_both(AIRBORNE[name]()))
    alone = contacts(pair[:, :1])
    assert np.mean([each.touching for each in alone if each.time < 1]) > 0.1
    assert not any(each.touching for each in contacts(pair))


@pytest.mark.parametrize("name", ["speech", "music"])
def test_a_touch_beside_what_is_there_from_the_beginning_is_felt(name: str) -> None:
    pair = heard_by_both(AIRBORNE[name]())
    pair = 4 * begun(touched(pair, BEGINS + 0.2, BEGINS + 0.6))
    found = contacts(pair)
    begins = next(each.time for each in found if each.touching)
    assert 0.2 < begins < 0.3
    assert all(each.touching for each in found if begins < each.time < 0.6)
    assert not any(each.touching for each in found if each.time > 0.9)


def test_a_run_that_begins_in_a_touch_is_felt_as_without_an_air_microphone() -> None:
    pair = touched(heard_by_both(np.zeros(round(SECONDS * RATE))), 0.5, 2.5)
    during = pair[RATE:]
    assert contacts(during) == contacts(during[:, :1])


def test_a_touch_in_a_quiet_room_is_felt_as_without_an_air_microphone() -> None:
    pair = touched(heard_by_both(np.zeros(round(SECONDS * RATE))), 2.0, 2.5)
    assert contacts(pair) == contacts(pair[:, :1])


def test_steady_noise_of_a_loud_room_hides_no_touch() -> None:
    pair = touched(heard_by_both(np.zeros(round(SECONDS * RATE))), 2.0, 2.5)
    # As loud in the air as the touch is in the contact microphone.
    pair[:, 1:] += noise(level_dbfs=-30, duration=SECONDS, channels=1, seed=8)
    assert contacts(pair) == contacts(pair[:, :1])


def test_one_microphone_and_a_silent_second_change_nothing() -> None:
    speech = heard_by_both(syllables())
    alone = contacts(speech[:, :1], pair=False)
    assert contacts(speech, pair=False) == alone
    assert contacts(speech[:, :1]) == alone
    silent = speech * np.float32([1, 0])
    assert contacts(silent) == alone


@pytest.mark.parametrize("size", ODD_SIZES)
def test_any_block_size_gives_the_same_contact(size: int) -> None:
    pair = touched(heard_by_both(syllables()), 2.0, 2.5)[: 3 * RATE]
    if size == 1:
        pair = pair[: RATE + 2000]
    assert contacts(pair, size=size) == contacts(pair, size=len(pair))


def test_sound_in_the_air_is_forgotten_at_a_reset() -> None:
    pair = touched(heard_by_both(syllables()), 2.0, 2.5)
    used = gate()
    used.push(AudioBlock(pair, RATE))
    used.reset()
    assert used.push(AudioBlock(pair, RATE)) == gate().push(AudioBlock(pair, RATE))
