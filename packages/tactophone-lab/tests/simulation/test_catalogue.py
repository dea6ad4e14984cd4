import tomllib
from importlib import resources

import pytest

from tactophone.core.errors import DatasetError
from tactophone.core.types import Touch
from tactophone_lab.simulation.catalogue import (
    PAPER,
    TEST,
    catalogue,
    find,
    surface,
    surface_roughness,
)

AUTHORS_ROUGH = {0, 1, 8, 11, 13, 15, 17, 19, 20, 22}


def test_the_papers_objects_have_the_authors_labels() -> None:
    labels = {obj.number: obj.label for obj in catalogue() if obj.number in PAPER}
    assert {
        number for number, label in labels.items() if label is Touch.ROUGH
    } == AUTHORS_ROUGH
    assert len(labels) == 23


def test_test_objects_share_no_surface_with_the_others() -> None:
    tested = {obj.surface.name for obj in catalogue() if obj.number in TEST}
    trained = {obj.surface.name for obj in catalogue() if obj.number not in TEST}
    assert not tested & trained


def test_rough_objects_are_rougher_than_every_smooth_one() -> None:
    rough = [obj.roughness.ra for obj in catalogue() if obj.label is Touch.ROUGH]
    smooth = [obj.roughness.ra for obj in catalogue() if obj.label is Touch.SMOOTH]
    assert min(rough) > max(smooth)


TABLES = tomllib.loads(
    (resources.files("tactophone_lab.simulation") / "catalogue.toml").read_text()
)["surfaces"]
PUBLISHED_RA_UM = {
    name: table["published_ra_um"]
    for name, table in TABLES.items()
    if "published_ra_um" in table
}


@pytest.mark.parametrize("name", sorted(PUBLISHED_RA_UM))
def test_ra_lies_where_the_source_has_it(name: str) -> None:
    low, high = PUBLISHED_RA_UM[name]
    assert low <= 1e6 * surface_roughness(surface(name)[0]).ra <= high


def test_every_profile_has_a_seed_of_its_own() -> None:
    seeds = {obj.surface.name: obj.surface.seed for obj in catalogue()}
    assert len(set(seeds.values())) == len(seeds)


def test_an_unknown_object_is_answered_with_the_known() -> None:
    with pytest.raises(DatasetError, match="0 lava stone, 1 sandstone"):
        find("cheese")
