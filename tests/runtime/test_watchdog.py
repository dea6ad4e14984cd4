import numpy as np

from tactophone.runtime.watchdog import LOOK_EVERY, Patience, Watchdog
from tactophone.telemetry import Pulse


def first_bite(pulses: list[Pulse], *, every: float = LOOK_EVERY, patience: Patience | None = None) -> float | None:
    """Time of the look at which the watchdog ends the process."""
    watchdog = Watchdog(patience or Patience())
    for index, pulse in enumerate(pulses):
        if watchdog.look(pulse, now=index * every):
            return index * every
    return None


def test_a_stall_while_vibrating_ends_within_the_promise() -> None:
    lively = [Pulse(callbacks=n, amplitude=0.5, beat=n) for n in range(1, 21)]
    bite = first_bite(lively + [lively[-1]] * 100)
    assert bite is not None
    assert bite - 19 * LOOK_EVERY <= 0.06


def test_a_stall_while_silent_is_given_time() -> None:
    bite = first_bite([Pulse(callbacks=7, amplitude=0.0, beat=1.0)] * 1000)
    assert bite is not None
    assert 1.9 < bite < 2.1


def test_a_process_that_goes_on_is_left_alone() -> None:
    assert first_bite([Pulse(callbacks=n, amplitude=1.0, beat=n) for n in range(2000)]) is None


def test_a_device_that_was_never_there_is_not_a_stall() -> None:
    assert first_bite([Pulse(callbacks=0, amplitude=0.0, beat=n) for n in range(2000)]) is None


def test_long_periods_are_waited_for() -> None:
    period = 2048 / 48_000
    pulses = [
        Pulse(callbacks=1 + int(n * LOOK_EVERY / period), amplitude=0.5, beat=n, period=period) for n in range(500)
    ]
    assert first_bite(pulses) is None


def test_looks_that_were_late_themselves_prove_nothing() -> None:
    watchdog = Watchdog(Patience())
    stalled = Pulse(callbacks=3, amplitude=0.5, beat=1.0)
    bites = [watchdog.look(stalled, now=time) for time in np.cumsum([0.0, 0.005, 0.2, 0.005])]
    assert not any(bites)
