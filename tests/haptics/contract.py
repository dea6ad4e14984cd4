"""What every actuator promises, whatever is behind it."""

import threading
from collections.abc import Callable

from tactophone.haptics import Actuator
from tactophone.haptics.actuator import Render
from tactophone.types import FloatArray

PATIENCE = 5.0
"""Seconds after which a device that should have called is given up."""


class Counting:
    """Renders a level and tells when it has been asked for so many periods."""

    def __init__(self) -> None:
        self.level = 0.0
        self.sizes: list[int] = []
        self.fails = False
        self._wanted = threading.Condition()

    def __call__(self, out: FloatArray) -> None:
        with self._wanted:
            self.sizes.append(len(out))
            self._wanted.notify_all()
        if self.fails:
            raise RuntimeError("a render that fails")
        out[:] = self.level

    def wait(self, more: int) -> None:
        with self._wanted:
            goal = len(self.sizes) + more
            assert self._wanted.wait_for(lambda: len(self.sizes) >= goal, PATIENCE), "the device stopped calling"


def asks_for_the_waveform_again_and_again(make: Callable[[Render], Actuator]) -> None:
    render = Counting()
    with make(render) as actuator:
        render.wait(20)
        assert actuator.device.fault == ""
        assert actuator.device.sample_rate == 48_000
        assert actuator.device.latency >= 0.0
    assert min(render.sizes) > 0


def a_render_that_fails_is_counted_and_asked_again(make: Callable[[Render], Actuator]) -> None:
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


def nothing_is_asked_for_after_the_end(make: Callable[[Render], Actuator]) -> None:
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
    asks_for_the_waveform_again_and_again,
    a_render_that_fails_is_counted_and_asked_again,
    nothing_is_asked_for_after_the_end,
    can_be_entered_again,
)

__all__ = ["ALL", "Counting"]
