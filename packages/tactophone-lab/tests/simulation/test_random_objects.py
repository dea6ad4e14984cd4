from dataclasses import replace

import numpy as np
import pytest

from tactophone.core.errors import ConfigError
from tactophone.core.types import Touch
from tactophone_lab.app.simulate import objects_named, plan_recordings
from tactophone_lab.simulation.catalogue import catalogue
from tactophone_lab.simulation.random_objects import (
    BUILDS,
    GIGAPASCAL,
    draw_object,
    draw_objects,
)
from tactophone_lab.simulation.render import RenderOptions, render
from tactophone_lab.simulation.takes import takes_named


def test_an_object_stays_the_same_whatever_number_is_drawn_beside_it() -> None:
    assert draw_objects(3, 7)[2] == draw_objects(9, 7)[2] == draw_object(2, 7)
    assert draw_object(2, 7) != replace(draw_object(2, 8), number=7002)


def test_objects_of_two_seeds_never_share_a_name_a_number_or_a_profile() -> None:
    drawn = [*catalogue(), *draw_objects(50, 0), *draw_objects(50, 1)]
    assert len({obj.number for obj in drawn}) == len(drawn)
    assert len({obj.name for obj in drawn}) == len(drawn)
    random = drawn[len(catalogue()) :]
    assert len({obj.surface.seed for obj in random}) == len(random)


def test_half_of_them_are_rough_and_rough_ones_have_the_greater_height() -> None:
    drawn = draw_objects(60, 3)
    heights = {
        label: [obj.roughness.ra for obj in drawn if obj.label is label]
        for label in (Touch.SMOOTH, Touch.ROUGH)
    }
    assert len(heights[Touch.ROUGH]) == len(heights[Touch.SMOOTH]) == 30
    assert max(heights[Touch.SMOOTH]) < min(heights[Touch.ROUGH])


def test_stiffness_mass_and_mounting_are_those_of_the_build() -> None:
    by_name = {build.name: build for build in BUILDS}
    for obj in draw_objects(60, 5):
        build = by_name[obj.name.split(" ", 2)[2]]
        assert obj.body is build.body
        assert obj.mounting in build.mountings
        low, high = build.modulus
        assert low * GIGAPASCAL <= obj.material.modulus <= high * GIGAPASCAL
        assert build.mass.low <= obj.mass <= build.mass.high
        assert obj.material.static > obj.material.kinetic


def test_a_random_object_is_rendered_like_one_of_the_catalogue() -> None:
    (job,) = plan_recordings(
        objects_named("random:1:7"), takes_named("wiggle"), RenderOptions(1.0)
    )
    samples, truth = render(job)
    assert samples.shape == (48_000, 2)
    assert np.all(np.isfinite(samples))
    assert np.any(truth.object_index >= 0)


@pytest.mark.parametrize("text", ["random", "random:0:1", "random:1001:1", "random:4"])
def test_random_objects_without_a_count_or_seed_say_what_is_wanted(text: str) -> None:
    with pytest.raises(ConfigError, match="wanted random:COUNT:SEED"):
        objects_named(text)
