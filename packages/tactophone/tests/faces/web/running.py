"""A run to look at: telemetry written in real time by a thread, with a stroke over
something rough in it."""

import threading
import time
from dataclasses import replace
from multiprocessing.connection import Connection
from types import TracebackType
from typing import Self

import numpy as np

from tactophone.core.types import (
    AudioBlock,
    HapticCommand,
    PipelineStep,
    Prediction,
    Touch,
)
from tactophone.live.runtime.output_gate import EMERGENCY_STOP
from tactophone.live.telemetry.layout import Fault, FingerState, RunState
from tactophone.live.telemetry.writer import Telemetry
from tactophone_lab.game.stone_box import Point

RATE = 48_000
STEP = 480

MUTED_BECAUSE = {"arm": "", "mute": "muted on the page", "stop": EMERGENCY_STOP}


class Run:
    """Writes 100 steps a second; obeys ``mute``, ``arm`` and levels as a runtime does.

    With an ``inbox`` it is led like `simulation.StoneBoxSource`, and knows at once what
    it touches.
    """

    def __init__(self, name: str, inbox: Connection | None = None) -> None:
        self._inbox = inbox
        self._order: tuple[int, ...] = ()
        self.telemetry = Telemetry(name)
        self.touch = Touch.NONE
        self.buzzes = 0
        self.state = RunState(
            role="receive",
            profiles=("paper", "plain"),
            source="simulated finger",
            link="127.0.0.1:48470",
            output="JACK system:playback_1",
            fingers=(
                FingerState(
                    armed=True,
                    muted_because="",
                    ceiling=0.5,
                    local_ceiling=0.5,
                    profile="paper",
                    threshold_dbfs=-52.0,
                    noise_floor_dbfs=-71.0,
                    can_buzz=True,
                ),
            ),
        )
        self._rng = np.random.default_rng(1)
        self._ended = threading.Event()
        self.silent = False
        self._thread = threading.Thread(target=self._go)

    def __enter__(self) -> Self:
        self._thread.start()
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        trace: TracebackType | None,
    ) -> None:
        self._ended.set()
        self._thread.join()
        self.telemetry.__exit__()

    def pause(self) -> None:
        """Give no sign of life any more."""
        self._ended.set()

    def fail(self, *faults: Fault) -> None:
        self.state = replace(self.state, faults=faults)

    @property
    def finger(self) -> FingerState:
        return self.state.fingers[0]

    def _change(self, **entries: object) -> None:
        self.state = replace(self.state, fingers=(replace(self.finger, **entries),))  # type: ignore[arg-type]

    def _go(self) -> None:
        begin, step = time.monotonic(), 0
        while not self._ended.wait(
            max(0.0, begin + step * STEP / RATE - time.monotonic())
        ):
            self._obey()
            self._follow()
            if self.silent:  # the robot's side hangs, and this side lives
                self.telemetry.update(self.state, now=time.monotonic())
            else:
                self._step(step)
            step += 1

    def _obey(self) -> None:
        for request in self.telemetry.requests():
            if request.action in MUTED_BECAUSE:
                self._change(
                    armed=request.action == "arm",
                    muted_because=MUTED_BECAUSE[request.action],
                )
            elif request.action == "profile":
                self._change(profile=request.text)
            elif request.action == "buzz":
                self.buzzes += 1
            else:
                self._change(**{request.action.removeprefix("lower_"): request.value})

    def _follow(self) -> None:
        while self._inbox is not None and self._inbox.poll():
            word, *arguments = self._inbox.recv()
            if word == "lay":
                self._order = arguments[0]
            else:
                stone = Point(0, *arguments).stone
                self.touch = (
                    Touch(self._order[stone])
                    if stone >= 0 and self._order
                    else Touch.NONE
                )

    def _step(self, step: int) -> None:
        loud = {Touch.NONE: 3e-4, Touch.SMOOTH: 0.02, Touch.ROUGH: 0.12}[self.touch]
        swing = 0.3 + abs(np.sin(step / 40))
        samples = (
            loud * swing * self._rng.standard_normal((STEP, 2)) * [1, 0.4]
        ).astype(np.float32)
        times = (step * STEP + np.arange(STEP)) / RATE
        amplitude = {Touch.NONE: 0.0, Touch.SMOOTH: 0.056, Touch.ROUGH: 0.5}[
            self.touch
        ] * self.state.armed
        frequency = 60.0 if self.touch is Touch.ROUGH else 120.0
        self.telemetry.rendered(
            (amplitude * np.sin(2 * np.pi * frequency * times)).astype(np.float32)
        )
        level = 20 * np.log10(np.sqrt(np.mean(samples[:, 0] ** 2)))
        sure = np.full(3, 0.04)
        sure[self.touch] = 0.92
        prediction = Prediction(
            tuple(sure), self.touch, float(sure[2]), float(level), times[0], times[-1]
        )
        tick = PipelineStep(
            AudioBlock(samples, RATE, step * STEP),
            (prediction,),
            (HapticCommand(amplitude, frequency, times[-1]),),
        )
        self.telemetry.publish(tick, now=time.monotonic(), truth=int(self.touch))
        self.telemetry.update(self.state, now=time.monotonic())
