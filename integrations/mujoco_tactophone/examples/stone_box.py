"""Play StoneBox-v0 with the scripted policy: ``python stone_box.py --episodes 10
[--random] [--picture out.png]``."""

import argparse

import gymnasium
import mujoco
import numpy as np
import soundfile
from mujoco_tactophone import ContactMicrophone
from mujoco_tactophone.stone_box import Scripted
from mujoco_tactophone.world import STEP, pressed, stones_model, stroke


def solved(episodes: int, *, random: bool) -> tuple[int, int]:
    """Return how many episodes end with the rough stone, and how many actions all
    took."""
    box, right, actions = gymnasium.make("mujoco_tactophone:StoneBox-v0"), 0, 0
    box.action_space.seed(1)
    for episode in range(episodes):
        observation, _ = box.reset(seed=episode)
        policy, over = Scripted(), False
        while not over:
            action = box.action_space.sample() if random else policy.act(observation)
            observation, reward, ended, cut, _ = box.step(action)
            right, actions, over = right + int(reward), actions + 1, ended or cut
    return right, actions


def heard(name: str, seconds: float = 4.0) -> tuple[np.ndarray, list[float]]:
    """Stroke a stone of the catalogue; return the sound and the slip at each step."""
    model = stones_model([name])
    data = mujoco.MjData(model)
    microphone, blocks, slips = ContactMicrophone(model, data, "tip"), [], []
    for step in range(round(seconds / STEP)):
        now = step * STEP
        data.ctrl[:] = (
            stroke(now - 1) if now > 1 else 0,
            0,
            pressed(1.0 if now > 0.3 else 0.0, data.qpos[2]),
        )
        mujoco.mj_step(model, data)
        microphone.step()
        blocks.append(microphone.read().samples)
        slips.append(microphone.slip)
    return np.concatenate(blocks), slips


def draw(path: str) -> None:
    """Draw the sound of a smooth and a rough stone over the slip."""
    import matplotlib.pyplot as plt

    figure, axes = plt.subplots(
        3, 2, figsize=(10, 6), sharex=True, sharey="row", constrained_layout=True
    )
    for column, name in zip(axes.T, ("polished marble", "lava stone"), strict=True):
        sound, slips = heard(name)
        soundfile.write(f"{name.replace(' ', '-')}.wav", sound, 48_000)
        column[0].plot(np.arange(len(slips)) * STEP, 100 * np.array(slips), color="0.3")
        for axis, channel, what in zip(
            column[1:], sound.T, ("contact", "air"), strict=True
        ):
            axis.specgram(
                channel,
                NFFT=1024,
                Fs=48_000,
                noverlap=512,
                vmin=-130,
                vmax=-50 if what == "air" else -30,
                cmap="magma",
            )
            axis.set(yscale="log", ylim=(60, 20_000), ylabel=f"{what} [Hz]")
        column[0].set(title=name, ylabel="slip [cm/s]")
        column[2].set(xlabel="time [s]")
    figure.savefig(path, dpi=110)


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--episodes", type=int, default=5)
    parser.add_argument("--random", action="store_true")
    parser.add_argument("--picture")
    arguments = parser.parse_args()
    found, taken = solved(arguments.episodes, random=arguments.random)
    print(
        f"{found} of {arguments.episodes} episodes solved, "
        f"{taken / max(arguments.episodes, 1):.0f} actions each"
    )
    if arguments.picture:
        draw(arguments.picture)
