import subprocess
import sys

import pytest

import tactophone.simulation

LIGHT = "import sys, tactophone.simulation, tactophone.game, tactophone.cli.simulate, tactophone.cli.play"


def test_importing_the_room_loads_neither_numba_nor_scipy() -> None:
    code = f"{LIGHT}; assert not {{'numba', 'scipy', 'aiohttp'}} & set(sys.modules)"
    subprocess.run([sys.executable, "-c", code], check=True)


def test_an_unknown_name_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="nonesuch"):
        _ = tactophone.simulation.nonesuch
