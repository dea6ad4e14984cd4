"""Machine code for the sample loops: numba, compiled once and kept on disk.

The code is kept beside the source, or in the user's cache folder where the installation is read-only. Beware:
numba looks for changes only in the file that a kernel stands in, so what a kernel calls stands in the same file; after
changing a tuple or a constant that it takes from another, save the kernel's file too.
"""

from collections.abc import Callable
from typing import Any, TypeVar, cast

from tactophone.errors import ConfigError

try:
    import numba
except ImportError as error:  # pragma: no cover
    raise ConfigError(
        "the simulated finger needs numba and scipy, which are not installed: pip install 'tactophone[sim]'"
    ) from error

Kernel = TypeVar("Kernel", bound=Callable[..., Any])


def compiled(kernel: Kernel) -> Kernel:
    """Compile a sample loop at its first call, without the interpreter lock, strictly IEEE so that bits repeat."""
    return cast(Kernel, numba.njit(cache=True, nogil=True)(kernel))
