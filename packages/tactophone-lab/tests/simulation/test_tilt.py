import numpy as np
import pytest

from tactophone_lab.simulation.catalogue import catalogue
from tactophone_lab.simulation.finger import Finger
from tactophone_lab.simulation.render import RenderOptions, plan_dataset, render
from tactophone_lab.simulation.takes import TAKES


def test_a_tilted_finger_gives_by_both_stiffnesses_of_its_bed() -> None:
    flat = Finger()
    assert flat.tilted(0) == flat
    side, turned = flat.tilted(90), flat.tilted(45)
    assert side.pad_stiffness == pytest.approx(flat.shear_stiffness)
    assert side.normal_strain == pytest.approx(flat.shear_strain)
    assert 1 / turned.pad_stiffness == pytest.approx(
        0.5 / flat.pad_stiffness + 0.5 / flat.shear_stiffness
    )


def test_each_tilt_renders_other_sound_and_none_the_same_to_the_bit() -> None:
    obj, take = catalogue()[9], TAKES[0]
    tilts = {
        tilt: render(
            plan_dataset([obj], RenderOptions(1.0, tilt=tilt), takes=[take])[0]
        )[0]
        for tilt in (0, 30, 60)
    }
    assert not np.array_equal(tilts[0], tilts[30])
    assert not np.array_equal(tilts[30], tilts[60])
    levels = [float(np.sqrt(np.mean(sound[:, 0] ** 2))) for sound in tilts.values()]
    assert max(levels) < 4 * min(levels)
