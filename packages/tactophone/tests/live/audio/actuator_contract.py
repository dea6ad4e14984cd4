"""The contract of every actuator."""

import threading
from collections.abc import Callable

from tactophone.core.types import FloatArray
from tactophone.live.audio.actuator import Actuator, Render

TIMEOUT = 5.0
"""Seconds after which a device that should have called counts as failed."""


class Counting:
    """Renders a constant level, counts its periods and waits for more of them; one that
    ``fails`` raises after it has written."""

    def __init__(self) -> None:
        self.level = 0.0
        self.sizes: list[int] = []
        self.fails = False
        self._called = threading.Condition()

    def __call__(self, out: FloatArray) -> None:
        with self._called:
            self.sizes.append(len(out))
            self._called.notify_all()
        # What fails has usually written a part of its period.
        out[:] = self.level
        if self.fails:
            raise RuntimeError("a render that fails")

    def wait(self, more: int) -> None:
        with self._called:
            goal = len(self.sizes) + more
            assert self._called.wait_for(lambda: len(self.sizes) >= goal, TIMEOUT), (
                "the device stopped calling"
            )


def calls_for_the_waveform_periodically(make: Callable[[Render], Actuator]) -> None:
    render = Counting()
    with make(render) as actuator:
        render.wait(20)
        assert actuator.device.fault == ""
        assert actuator.device.sample_rate == 48_000
        assert actuator.device.latency >= 0.0
    assert min(render.sizes) > 0


def a_render_that_fails_is_counted_and_called_again(
    make: Callable[[Render], Actuator],
) -> None:
    render = Counting()
    render.level = 0.5
    render.fails = True
    with make(render) as actuator:
        render.wait(5)
        assert actuator.device.process_faults >= 4
        render.fails = False
        render.wait(5)
        faults = actuator.device.process_faults
        render.wait(5)
        assert actuator.device.process_faults == faults


def nothing_is_called_after_the_end(make: Callable[[Render], Actuator]) -> None:
    render = Counting()
    with make(render):
        render.wait(3)
    periods = len(render.sizes)
    threading.Event().wait(0.05)
    assert len(render.sizes) == periods


def can_be_entered_again(make: Callable[[Render], Actuator]) -> None:
    render = Counting()
    actuator = make(render)
    for _ in range(2):
        with actuator:
            render.wait(3)


ALL = (
    calls_for_the_waveform_periodically,
    a_render_that_fails_is_counted_and_called_again,
    nothing_is_called_after_the_end,
    can_be_entered_again,
)

__all__ = ["ALL", "Counting"]
