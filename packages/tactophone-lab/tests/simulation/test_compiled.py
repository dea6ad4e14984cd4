"""The simulated finger in an installation where nothing can be written."""

import logging
from typing import Any

import pytest

from tactophone_lab.simulation import mechanics


def test_a_kernel_compiles_without_a_cache_and_says_so_once(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    compile_kernel = mechanics.numba.njit

    def without_locator(*kernels: Any, cache: bool = False, **options: Any) -> Any:
        if cache:
            raise RuntimeError("cannot cache function 'f': no locator available")
        return compile_kernel(*kernels, **options)

    monkeypatch.setattr(mechanics.numba, "njit", without_locator)

    def double(value: float) -> float:
        return 2 * value

    def treble(value: float) -> float:
        return 3 * value

    with caplog.at_level(logging.WARNING):
        assert mechanics.compiled(double)(1.5) == 3.0
        assert mechanics.compiled(treble)(1.5) == 4.5
    assert [record.levelname for record in caplog.records] == ["WARNING"]
    assert "NUMBA_CACHE_DIR" in caplog.text
