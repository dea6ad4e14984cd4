"""What this project needs of JACK-Client, the binding to libjack, beyond its documented
interface; nothing else reaches into it.

libjack cancels the threads of a client that it closes, in the middle of Python if they
are there. So what it calls back must be a function of the C library: registering one
takes libjack's own handle of a client (`handle_of`) and the library itself
(`library`), and memory that lives as long as the client (`keep_with`). The binding
offers only callbacks in Python.

And the sound of a period is needed as arrays that are made once (`PortArrays`). The
binding's own call makes an array each time, and takes six times as long.

``packages/tactophone/tests/live/audio/test_jack_binding.py`` fails when a release of
JACK-Client changes what is used here.
"""

import ctypes
import functools
from collections.abc import Iterable
from typing import Any

import numpy as np

from tactophone.core.errors import DeviceError
from tactophone.core.types import FloatArray


@functools.cache
def jack_module() -> Any:
    """Import the JACK binding, which needs an extra and the system library, and silence
    the library's messages."""
    try:
        import jack
    except ImportError:
        raise DeviceError(
            "JACK-Client is not installed: `pip install 'tactophone[jack]'`, "
            "or choose portaudio"
        ) from None
    except OSError:
        raise DeviceError(
            "libjack is not installed: `apt install jackd2`, or choose portaudio"
        ) from None
    # A function of the C library that does nothing: libjack's threads call it too, and
    # must not enter Python.
    for name in ("jack_set_error_function", "jack_set_info_function"):
        getattr(ctypes.CDLL(jack._libname), name)(address("strlen"))
    return jack


def library() -> ctypes.CDLL:
    """Return libjack itself, as loaded by the binding."""
    return ctypes.CDLL(jack_module()._libname)


def address(name: str) -> ctypes.c_void_p:
    """Return the address of a function of the C library."""
    return ctypes.cast(getattr(ctypes.CDLL(None), name), ctypes.c_void_p)


def handle_of(client: Any) -> ctypes.c_void_p:
    """Return libjack's handle of a client of the binding."""
    return ctypes.c_void_p(int(jack_module()._ffi.cast("uintptr_t", client._ptr)))


def keep_with(client: Any, value: object) -> None:
    """Keep a value alive for as long as a client of the binding."""
    client._keepalive.append(value)


class PortArrays:
    """The sound of some ports as arrays, in each period.

    A port has one of a few buffers, which JACK names anew in each period. The array of
    a buffer is made once.
    """

    def __init__(self, ports: Iterable[Any]) -> None:
        jack = jack_module()
        self._handles = [port._ptr for port in ports]
        self._ffi = jack._ffi
        self._buffer_of = jack._lib.jack_port_get_buffer
        self._arrays: dict[Any, FloatArray] = {}

    def now(self, size: int) -> list[FloatArray]:
        """Return an array of ``size`` samples for each port; call it in the process
        callback only."""
        found = []
        for handle in self._handles:
            buffer = self._buffer_of(handle, size)
            array = self._arrays.get(buffer)
            if array is None or len(array) != size:
                memory = self._ffi.buffer(buffer, 4 * size)
                array = np.frombuffer(memory, np.float32)
                self._arrays[buffer] = array
            found.append(array)
        return found
