"""Does touch help a policy? ``python touch_policy.py [--steps 4000]``, in minutes to an
hour of one core.

Trains LeRobot's ACT on scripted episodes of StoneBox-v0 (find the rough one of five
stones) and counts how often it finds the stone in boxes that it has never seen. ACT
gets states alone, no picture, and one moment at a time. The arms differ in what the
state holds:

- *blind*: the finger's place, speed and force;
- *touch*: also contact and slip, as `lerobot_robot_tactophone` offers them;
- *roughness*: also the detector's probability of rough.

Needs lerobot 0.6.1 and its torch, in an environment of its own. All of it is simulated,
and training and test share the same three surfaces.
"""

import argparse
import sys
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import gymnasium
import numpy as np
import torch
from lerobot.configs.types import FeatureType, PolicyFeature
from lerobot.policies.act.configuration_act import ACTConfig
from lerobot.policies.act.modeling_act import ACTPolicy
from numpy.typing import NDArray

sys.path.insert(0, str(Path(__file__).parents[1] / "lerobot_robot_tactophone"))
from lerobot_robot_tactophone import slip_magnitude
from mujoco_tactophone.stone_box import FASTEST, STONES, TURN, Values
from mujoco_tactophone.world import PITCH

from tactophone import Touch

ARMS = {"blind": 3, "touch": 5, "roughness": 6}
"""How many of `seen`'s values the state of each arm holds."""

SEEDS = 3
CHUNK = 8
"""Actions that ACT predicts at once; after two of them it is asked anew."""

BATCH = 128

LEFT, RIGHT = -0.025, (STONES - 1) * PITCH + 0.025
"""Metres where the sweep begins and ends."""

ON_STONE = 0.036
"""Metres from a stone's middle up to which the finger presses."""

HOLDS = 12
"""Turns for which a demonstrated choice is held, as a person holds a button. It ends an
episode, and would otherwise be one of ninety actions."""

TOUCHED = 6
"""Turns of touch before the demonstrator may choose."""


def seen(box: gymnasium.Env, observation: Values, before: Values) -> Values:
    """Return place (m), speed (of the fastest), force (N), contact (0, 1), slip (0-1)
    and the probability of rough of this turn."""
    newest = box.unwrapped.predictions[-1:]
    contact = float(any(found.touch != Touch.NONE for found in newest))
    slip = sum(slip_magnitude(found) for found in newest)
    x, force, _, _, rough, _ = observation
    speed = (x - before[0]) / (FASTEST * TURN)
    return np.array([x, speed, force, contact, slip, rough], np.float32)


@dataclass
class Demonstrator:
    """Sweeps over the stones from left to right, and chooses the first that feels
    rough; the last one, if none does."""

    felt: list[float] = field(default_factory=list)
    sweeps: bool = False

    def act(self, now: Values) -> Values:
        x, rough = float(now[0]), float(now[5])
        self.sweeps = self.sweeps or x < LEFT
        if not self.sweeps:
            return np.array([-1, -1, -1], np.float32)
        on_stone = abs(x - PITCH * round(x / PITCH)) < ON_STONE
        self.felt = [*self.felt, rough] if on_stone else []
        sure = len(self.felt) > TOUCHED and np.mean(self.felt[2:]) > 0.5
        choose = 1 if sure or x > RIGHT else -1
        return np.array([0.5, 0.5 if on_stone else -1, choose], np.float32)


@dataclass
class Episode:
    states: NDArray[np.float32]
    actions: NDArray[np.float32]
    found: bool


def play(seed: int, act: Callable[[Values], Values]) -> Episode:
    """Play one box: ``act`` returns the action for what is `seen`."""
    box = gymnasium.make("mujoco_tactophone:StoneBox-v0")
    observation, _ = box.reset(seed=seed)
    now = seen(box, observation, observation)
    states, actions, over, reward = [], [], False, 0.0
    while not over:
        action = act(now)
        states.append(now)
        actions.append(action)
        before = observation
        observation, reward, ended, cut, _ = box.step(action)
        now, over = seen(box, observation, before), ended or cut
    states += [states[-1]] * HOLDS
    actions += [actions[-1]] * HOLDS
    return Episode(np.array(states), np.array(actions), reward > 0)


class Chunks:
    """States, each with the actions that followed, in units of their deviation."""

    def __init__(self, episodes: list[Episode], size: int) -> None:
        states = np.concatenate([episode.states for episode in episodes])[:, :size]
        self.mean, self.deviation = states.mean(0), states.std(0) + 1e-6
        self.size = size
        rows, pads = [], []
        for episode in episodes:
            ends = len(episode.actions) - 1
            at = np.arange(len(episode.actions))[:, None] + np.arange(CHUNK)
            rows.append(episode.actions[np.minimum(at, ends)])
            pads.append(at > ends)
        self._states = torch.from_numpy(self.scaled(states))
        self._actions = torch.from_numpy(np.concatenate(rows))
        self._pads = torch.from_numpy(np.concatenate(pads))

    def scaled(self, states: NDArray[np.float32]) -> NDArray[np.float32]:
        return (states[..., : self.size] - self.mean) / self.deviation

    def batch(self, generator: torch.Generator) -> dict[str, torch.Tensor]:
        rows = torch.randint(len(self._states), (BATCH,), generator=generator)
        return {
            **inputs(self._states[rows]),
            "action": self._actions[rows],
            "action_is_pad": self._pads[rows],
        }


def inputs(states: torch.Tensor) -> dict[str, torch.Tensor]:
    """Return what ACT takes: it refuses to run on ``observation.state`` alone."""
    return {
        "observation.state": states,
        "observation.environment_state": states[..., : ARMS["blind"]],
    }


def trained(chunks: Chunks, seed: int, steps: int) -> ACTPolicy:
    torch.manual_seed(seed)
    state = PolicyFeature(FeatureType.STATE, (chunks.size,))
    own = PolicyFeature(FeatureType.ENV, (ARMS["blind"],))
    policy = ACTPolicy(
        ACTConfig(
            input_features={
                "observation.state": state,
                "observation.environment_state": own,
            },
            output_features={"action": PolicyFeature(FeatureType.ACTION, (3,))},
            device="cpu",
            chunk_size=CHUNK,
            n_action_steps=2,
            dropout=0.0,
            dim_model=64,
            n_heads=4,
            dim_feedforward=128,
            n_encoder_layers=1,
            # The demonstrator has one way to do it, so there is no style to encode.
            use_vae=False,
        )
    )
    optimizer = torch.optim.AdamW(policy.parameters(), lr=2e-3, fused=True)
    slower = torch.optim.lr_scheduler.CosineAnnealingLR(optimizer, steps)
    generator = torch.Generator().manual_seed(seed)
    policy.train()
    for _ in range(steps):
        loss, _ = policy.forward(chunks.batch(generator))
        optimizer.zero_grad()
        loss.backward()
        optimizer.step()
        slower.step()
    return policy


def finds(policy: ACTPolicy, chunks: Chunks, seed: int) -> bool:
    """Return whether a policy finds the rough stone of a box."""
    policy.reset()

    def act(now: Values) -> Values:
        state = torch.from_numpy(chunks.scaled(now))[None]
        return policy.select_action(inputs(state))[0].numpy()

    return play(seed, act).found


def interval(successes: NDArray[np.float64]) -> str:
    """Return the mean of boxes and its 95 % interval by bootstrap, in words."""
    rng = np.random.default_rng(0)
    drawn = rng.choice(successes, (10_000, len(successes))).mean(1)
    low, high = np.quantile(drawn, [0.025, 0.975])
    return f"{successes.mean():+.2f} ({low:+.2f} to {high:+.2f})"


def main() -> None:
    parser = argparse.ArgumentParser(
        description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--episodes", type=int, default=16, help="shown to ACT")
    parser.add_argument("--boxes", type=int, default=6, help="of the test")
    parser.add_argument("--steps", type=int, default=1000, help="of training")
    arguments = parser.parse_args()
    torch.set_num_threads(1)
    shown = [play(seed, Demonstrator().act) for seed in range(arguments.episodes)]
    found = np.mean([episode.found for episode in shown])
    print(f"the demonstrator finds {found:.2f} of {len(shown)}", flush=True)
    of_arm = {}
    for arm, size in ARMS.items():
        chunks = Chunks(shown, size)
        rows = []
        for seed in range(SEEDS):
            policy = trained(chunks, seed, arguments.steps)
            tested = range(10_000, 10_000 + arguments.boxes)
            rows.append([finds(policy, chunks, box) for box in tested])
            print(f"{arm}, seed {seed}: {np.mean(rows[-1]):.2f}", flush=True)
        of_arm[arm] = np.mean(rows, axis=0)
    for arm, successes in of_arm.items():
        more = interval(successes - of_arm["blind"])
        print(f"{arm}: {interval(successes)}, more than blind: {more}")


if __name__ == "__main__":
    main()
