import numpy as np
import pytest

from tactophone.core.errors import ConfigError
from tactophone.core.types import AudioBlock
from tactophone_lab.simulation.catalogue import find
from tactophone_lab.simulation.faults import CODES, FaultSpan, FaultySource
from tactophone_lab.simulation.motion import single
from tactophone_lab.simulation.source import SimulatedFinger


def finger(size: int = 480) -> SimulatedFinger:
    return SimulatedFinger(single(find("lava stone")), duration=0.2, block_size=size)


def recorded(code: str, size: int) -> np.ndarray:
    with FaultySource(finger(size), [FaultSpan(code, 0.05, 0.1333)]) as source:
        return np.concatenate([block.samples for block in source])


@pytest.mark.parametrize("code", CODES)
def test_blocks_of_any_size_are_broken_alike_and_only_while_the_fault_lasts(
    code: str,
) -> None:
    whole = recorded(code, 9600)
    np.testing.assert_array_equal(recorded(code, 509), whole)
    good = np.concatenate([block.samples for block in finger()])
    differ = np.flatnonzero((whole != good).any(axis=1))
    assert 2400 <= differ[0] < differ[-1] < 6400


def test_a_faulty_source_is_as_wide_and_fast_as_the_good_one() -> None:
    source = FaultySource(finger(), [])
    assert (source.channels, source.sample_rate) == (2, 48_000)


@pytest.mark.parametrize("text", ["air-haunted", "air-dead@x", "air-dead@1-2-3"])
def test_an_unknown_fault_is_refused_with_the_choices(text: str) -> None:
    with pytest.raises(ConfigError, match="contact-dead"):
        FaultSpan.parse(text)


def test_a_block_keeps_its_place() -> None:
    block = AudioBlock(np.zeros((100, 2), np.float32), 48_000, 700, concealed=True)
    broken = FaultySource(finger(), [FaultSpan("alike")]).apply(block)
    assert (broken.start, broken.concealed) == (700, True)
