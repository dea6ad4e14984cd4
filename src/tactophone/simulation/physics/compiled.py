"""Compiles the sample loops with numba, once, and caches the machine code on disk.

The cache lies beside the source, or in the user's cache folder where the installation is read-only. Beware: numba
detects changes only in the file that defines a kernel. Everything that a kernel calls is therefore defined in the same
file; after changing a tuple or a constant that it imports, save the kernel's file too.
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
    """Compile a sample loop at its first call, without the interpreter lock; strictly IEEE, so that bits repeat."""
    return cast(Kernel, numba.njit(cache=True, nogil=True)(kernel))
