import numpy as np
import pytest

from tactophone_lab.simulation.modes import Body, Mode, Mounting, body_modes, mode_table


@pytest.mark.parametrize("body", Body)
@pytest.mark.parametrize("mounting", Mounting)
def test_every_body_rings_stably_however_it_is_held(
    body: Body, mounting: Mounting
) -> None:
    modes = body_modes(body, mounting, mass=0.5, rng=np.random.default_rng(0))
    assert modes
    for mode in modes:
        # Semi-implicit Euler is stable while omega * step < 2; a quarter of that leaves
        # frequencies true.
        assert 0 < 2 * np.pi * mode.frequency / 96_000 < 0.6
        assert 0 < mode.damping < 1
        assert mode.mass > 0


def test_the_table_holds_what_the_kernel_wants() -> None:
    (row, empty) = mode_table([Mode(100.0, 0.5, 0.05, 1e-3, strain=0.2)], size=2)
    omega = 2 * np.pi * 100
    assert row["stiffness"] == pytest.approx(omega**2)
    assert row["mobility"] == 2.0
    assert row["damping"] == pytest.approx(0.1 * omega)
    assert row["strain"] == pytest.approx(0.2 * 0.5 * omega**2)
    assert not any(empty.item())
