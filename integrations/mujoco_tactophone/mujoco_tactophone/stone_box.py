"""StoneBox-v0: find the rough one of five stones, blind, by moving a finger over
them."""

from typing import Any

import gymnasium
import mujoco
import numpy as np
from numpy.typing import NDArray

from mujoco_tactophone.microphone import ContactMicrophone
from mujoco_tactophone.world import PITCH, STEP, pressed, stones_model
from tactophone import ConfigError, Pipeline, Prediction, open_pipeline
from tactophone_lab.simulation.modes import Mounting

STONES = 5
ROUGH = ("20", "22")
SMOOTH = "smooth competition stone"
TURN = 0.1
"""Seconds of an action."""

FASTEST = 0.12
"""Metres a second that an action of 1 moves the finger."""

STRONGEST = 1.5
"""Newtons that an action of 1 presses; 0 and less lift."""

MOST_TURNS = 250

Values = NDArray[np.float32]


class StoneBox(gymnasium.Env[Values, Values]):
    """Five stones, one of them rough.

    An action is ``(speed, press, choose)``, each -1 to 1. ``choose`` over 0.9 ends the
    episode with the stone under the finger, and the reward is 1 if that is the rough
    one. An observation is ``(x, force, none, smooth, rough, roughness)``: the finger's
    place in m, its force in N, and the means of the detector's predictions in this
    turn; ``predictions`` has each of them.
    """

    metadata: dict[str, Any] = {"render_modes": []}  # noqa: RUF012  # gymnasium's own attribute

    def __init__(self, tip: str = "pad", render_mode: str | None = None) -> None:
        if render_mode is not None:
            raise ConfigError(
                f"render_mode={render_mode!r}: StoneBox-v0 is felt and draws nothing; "
                "leave render_mode out"
            )
        self.render_mode = None
        self.action_space = gymnasium.spaces.Box(-1, 1, (3,), np.float32)
        self.observation_space = gymnasium.spaces.Box(-1, 100, (6,), np.float32)
        self._tip = tip
        self._running = False
        self.predictions: tuple[Prediction, ...] = ()

    def __getstate__(self) -> dict[str, Any]:
        """Return what a copy needs to begin anew: its tip and its random numbers.

        A running detector holds a session of ONNX Runtime, which no process can hand to
        another; a copy therefore begins with `reset`.
        """
        return {"tip": self._tip, "generator": self.np_random}

    def __setstate__(self, state: dict[str, Any]) -> None:
        self.__init__(state["tip"])  # type: ignore[misc]
        self.np_random = state["generator"]

    def reset(
        self, *, seed: int | None = None, options: dict[str, Any] | None = None
    ) -> tuple[Values, dict[str, Any]]:
        super().reset(seed=seed)
        self.rough = int(self.np_random.integers(STONES))
        names = [SMOOTH] * STONES
        names[self.rough] = ROUGH[int(self.np_random.integers(len(ROUGH)))]
        model = stones_model(names)
        self._model, self._data = model, mujoco.MjData(model)
        noise = int(self.np_random.integers(1 << 30))
        self._microphone = ContactMicrophone(
            model, self._data, "tip", self._tip, mounting=Mounting.MAT, seed=noise
        )
        self._pipeline: Pipeline = open_pipeline(
            sample_rate=48_000, channels=2, tip=self._tip
        )
        self._x, self._turns = PITCH * float(self.np_random.integers(STONES)), 0
        self._data.qpos[0], self._data.qpos[2] = self._x, 0.003
        for _ in range(5):  # the detector learns the noise of a finger in the air
            found = self._advance(0.0, -1.0)
        self._running = True
        return found, {}

    def step(self, action: Values) -> tuple[Values, float, bool, bool, dict[str, Any]]:
        if not self._running:
            raise gymnasium.error.ResetNeeded(
                "StoneBox-v0: step before reset; call reset() first"
            )
        if not np.all(np.isfinite(action)):
            raise ValueError(
                f"action {action}: not finite; give three numbers from -1 to 1"
            )
        speed, press, choose = (float(value) for value in np.clip(action, -1, 1))
        self._turns += 1
        if choose > 0.9:
            chosen = round(self._data.qpos[0] / PITCH)
            return (
                self._last,
                float(chosen == self.rough),
                True,
                False,
                {"chosen": chosen, "rough": self.rough},
            )
        return self._advance(speed, press), 0.0, False, self._turns >= MOST_TURNS, {}

    def _advance(self, speed: float, press: float) -> Values:
        rows = []
        for _ in range(round(TURN / STEP)):
            self._x = float(
                np.clip(
                    self._x + FASTEST * speed * STEP, -0.03, (STONES - 1) * PITCH + 0.03
                )
            )
            self._data.ctrl[:] = (
                self._x,
                0.0,
                pressed(STRONGEST * press, self._data.qpos[2]),
            )
            mujoco.mj_step(self._model, self._data)
            self._microphone.step()
        self.predictions = self._pipeline.push(self._microphone.read()).predictions
        for found in self.predictions:
            rows.append((*found.probabilities, found.roughness if found.touch else 0.0))
        mean = np.mean(rows, axis=0) if rows else np.zeros(4)
        self._last = np.array(
            [self._data.qpos[0], self._microphone.force, *mean], np.float32
        )
        return self._last


class Scripted:
    """Strokes each stone in turn and chooses the one that felt roughest."""

    def __init__(self) -> None:
        self._felt = np.zeros(STONES)
        self._stone, self._turn = 0, 0

    def act(self, observation: Values) -> Values:
        x, rough = float(observation[0]), float(observation[4])
        done = self._stone == STONES
        target = PITCH * (int(np.argmax(self._felt)) if done else self._stone)
        if self._turn == 0 and abs(x - target) > 0.008:
            return np.array(
                [np.clip((target - x) / (FASTEST * TURN), -1, 1), -1, -1], np.float32
            )
        if done:
            return np.array([0, -1, 1], np.float32)
        self._turn += 1
        self._felt[self._stone] += rough if self._turn > 3 else 0.0
        if self._turn > 12:
            self._stone, self._turn = self._stone + 1, 0
            return np.array([0, -1, -1], np.float32)
        return np.array(
            [0.6 if self._turn % 4 in (1, 2) else -0.6, 0.6, -1], np.float32
        )
