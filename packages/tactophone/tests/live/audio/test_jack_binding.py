"""JACK-Client still has what `jack_binding` takes from behind its documented
interface."""

import ctypes
import gc
import weakref

import numpy as np
import pytest

from tactophone.live.audio.dummy import DummyServer
from tactophone.live.audio.jack_binding import (
    PortArrays,
    handle_of,
    jack_module,
    keep_with,
    library,
)

pytestmark = pytest.mark.realtime


def test_the_binding_gives_its_library_its_handles_and_its_buffers() -> None:
    with DummyServer() as server:
        client = jack_module().Client(
            "binding", servername=server.name, no_start_server=True
        )
        name_of = library().jack_get_client_name
        name_of.argtypes = [ctypes.c_void_p]
        name_of.restype = ctypes.c_char_p
        assert name_of(handle_of(client)) == b"binding"
        port = client.outports.register("out")
        written: list[bool] = []

        def process(size: int) -> None:
            (array,) = arrays.now(size)
            array[:] = 0.25
            # The documented, slower way sees the same memory.
            written.append(bool(np.all(port.get_array() == np.float32(0.25))))

        arrays = PortArrays([port])
        client.set_process_callback(process)
        with client:
            while len(written) < 3:
                pass
        client.close()
    assert all(written)


def test_the_binding_keeps_a_value_as_long_as_its_client() -> None:
    class Kept:
        pass

    with DummyServer() as server:
        client = jack_module().Client(
            "keeper", servername=server.name, no_start_server=True
        )
        value = Kept()
        kept = weakref.ref(value)
        keep_with(client, value)
        del value
        gc.collect()
        assert kept() is not None
        client.close()
        del client
        gc.collect()
    assert kept() is None
