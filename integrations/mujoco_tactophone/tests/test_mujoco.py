"""The microphone of MuJoCo against the simulated finger, and the stone box."""

import pickle
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from numpy.typing import NDArray

mujoco = pytest.importorskip("mujoco")
pytest.importorskip("numba")
from mujoco_tactophone import ContactMicrophone
from mujoco_tactophone.world import STEP, pressed, stones_model, stroke

from tactophone import LIVE_SAMPLE_RATE, ConfigError
from tactophone_lab.simulation.motion import LIFT, Move
from tactophone_lab.simulation.source import SimulatedFinger

Sound = NDArray[np.float32]

STONES = ("polished marble", "smooth competition stone", "lava stone", "22")


def stroked(
    name: str, seconds: float, force: float = 1.0
) -> tuple[Sound, list[Move], ContactMicrophone]:
    """Press at 0.3 s and stroke from 1 s on; return the sound and the finger's true
    moves."""
    model = stones_model([name])
    data = mujoco.MjData(model)
    microphone, blocks, moves = ContactMicrophone(model, data, "tip"), [], []
    for step in range(round(seconds / STEP)):
        now = step * STEP
        data.ctrl[:] = (
            stroke(now - 1) if now > 1 else 0.0,
            0.0,
            pressed(force if now > 0.3 else 0.0, data.qpos[2]),
        )
        mujoco.mj_step(model, data)
        microphone.step()
        if step % 5 == 4:
            blocks.append(microphone.read().samples)
        moves.append(
            Move(
                now,
                float(data.qpos[0]),
                0.0,
                microphone.force if microphone.force > 0 else LIFT,
            )
        )
    return np.concatenate(blocks), moves, microphone


def thirds(sound: Sound) -> NDArray[np.float64]:
    """Level in dB of each third-octave from 100 Hz to 12.5 kHz, a row a channel."""
    signal = pytest.importorskip("scipy.signal")
    frequency, power = signal.welch(sound.T, LIVE_SAMPLE_RATE, nperseg=16384)
    centres = 1000 * 2.0 ** (np.arange(-10, 12) / 3)
    bands = [
        (frequency >= at * 2 ** (-1 / 6)) & (frequency < at * 2 ** (1 / 6))
        for at in centres
    ]
    return np.stack(
        [10 * np.log10(power[:, band].sum(axis=1)) for band in bands], axis=1
    )


def level(sound: Sound) -> float:
    return float(20 * np.log10(sound.std()))


def beside(name: str, seconds: float) -> tuple[Sound, Sound]:
    """Sound of a stroke from 1.5 s on, and that of the simulated finger on the same
    path with the same force."""
    sound, moves, microphone = stroked(name, seconds)
    (placed, *_) = microphone.finger.scene.placed
    x, y = placed.centre
    finger = SimulatedFinger(
        microphone.finger.scene,
        [Move(at, x + along, y, press) for at, along, _, press in moves],
        place=(x, y),
    )
    begin = round(1.5 * LIVE_SAMPLE_RATE)
    return sound[begin:], finger.render(len(sound)).samples[begin:]


@pytest.mark.parametrize("name", STONES)
def test_a_stroke_sounds_as_that_of_the_simulated_finger(name: str) -> None:
    apart = np.subtract(*map(thirds, beside(name, 7.0)))
    assert np.abs(apart.mean(axis=1)).max() < 0.3
    assert np.abs(apart).max() < 1.0


def test_nothing_is_heard_where_nothing_slips() -> None:
    sound, _, microphone = stroked("lava stone", 1.0)
    assert microphone.force == pytest.approx(1.0, abs=0.1)
    quiet, still = (
        sound[: round(0.2 * LIVE_SAMPLE_RATE)],
        sound[round(0.8 * LIVE_SAMPLE_RATE) :],
    )
    for channel in (0, 1):
        assert level(still[:, channel]) < level(quiet[:, channel]) + 3.0


def test_the_surface_of_a_geom_is_named_by_text_or_material() -> None:
    named = (
        '<asset><material name="brick"/></asset><custom><text name="a" '
        'data="{text}"/></custom>'
    )
    world = (
        '<geom name="a" type="box" size="1 1 1"/><geom name="b" type="box" '
        'size="1 1 1" material="brick"/>'
    )
    tip = '<body pos="0 0 3"><freejoint/><geom name="tip" size="0.01"/></body>'
    xml = f"<mujoco>{named}<worldbody>{world}{tip}</worldbody></mujoco>"
    model = mujoco.MjModel.from_xml_string(xml.format(text="lava stone"))
    assert (
        ContactMicrophone(model, mujoco.MjData(model), "tip").surfaces["a"]
        == "lava stone"
    )
    model = mujoco.MjModel.from_xml_string(xml.format(text="lava ston"))
    with pytest.raises(ConfigError, match="lava stone"):
        ContactMicrophone(model, mujoco.MjData(model), "tip")
    with pytest.raises(ConfigError, match="no geom 'thumb'"):
        ContactMicrophone(model, mujoco.MjData(model), "thumb")


def test_the_scripted_policy_finds_the_rough_stone() -> None:
    gymnasium = pytest.importorskip("gymnasium")
    from gymnasium.utils.env_checker import check_env
    from mujoco_tactophone.stone_box import Scripted, StoneBox

    check_env(StoneBox(), skip_render_check=True)
    box, solved = gymnasium.make("StoneBox-v0"), 0
    for episode in range(10):
        observation, _ = box.reset(seed=episode)
        policy, over = Scripted(), False
        while not over:
            observation, reward, ended, cut, _ = box.step(policy.act(observation))
            solved, over = solved + int(reward), ended or cut
    assert solved >= 9


def test_the_readmes_own_python_runs_in_a_fresh_interpreter() -> None:
    """Nothing but README's lines may register the task."""
    pytest.importorskip("gymnasium")
    readme = (Path(__file__).parents[1] / "README.md").read_text()
    python = re.findall(r"```python\n(.*?)```", readme, re.DOTALL)
    whole = [lines for lines in python if lines.startswith("import ")]
    assert whole
    for lines in whole:
        subprocess.run([sys.executable, "-c", lines], check=True, timeout=120)


def test_a_step_before_reset_and_an_action_that_is_no_number_are_refused() -> None:
    gymnasium = pytest.importorskip("gymnasium")
    from mujoco_tactophone.stone_box import StoneBox

    box = StoneBox()
    still = np.array([0, -1, -1], np.float32)
    with pytest.raises(gymnasium.error.ResetNeeded, match=r"call reset\(\)"):
        box.step(still)
    box.reset(seed=1)
    with pytest.raises(ValueError, match="not finite"):
        box.step(np.array([np.nan, -1, -1], np.float32))
    assert np.all(np.isfinite(box.step(still)[0]))
    with pytest.raises(ConfigError, match="draws nothing"):
        gymnasium.make("StoneBox-v0", render_mode="human")


def test_a_copy_of_a_running_box_continues_its_random_numbers() -> None:
    pytest.importorskip("gymnasium")
    from mujoco_tactophone.stone_box import StoneBox

    box = StoneBox()
    box.reset(seed=1)
    copied = pickle.loads(pickle.dumps(box))
    np.testing.assert_array_equal(copied.reset()[0], box.reset()[0])


def test_the_example_is_short() -> None:
    example = Path(__file__).parents[1] / "examples/stone_box.py"
    assert len(example.read_text().splitlines()) < 100
