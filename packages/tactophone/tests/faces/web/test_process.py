"""The page's process: where it listens, and that it ends with its parent."""

import socket
import subprocess
import sys
import time
import urllib.error
import urllib.request

import pytest

from tactophone.core.errors import TactophoneError
from tactophone.faces.web.server import watch


@pytest.mark.parametrize(
    "address", ["", "8470", "localhost", "127.0.0.1:", "127.0.0.1:http", "127.0.0.1:-1"]
)
def test_an_invalid_address_is_refused_with_an_example(address: str) -> None:
    with pytest.raises(TactophoneError, match=r"127\.0\.0\.1:0"):
        watch("none", address)


@pytest.mark.parametrize("address", ["192.0.2.1:0", "127.0.0.1:65536"])
def test_an_unavailable_address_is_refused(address: str) -> None:
    with pytest.raises(TactophoneError, match="choose another address"):
        watch("none", address)


def test_a_port_that_is_taken_is_refused() -> None:
    with socket.create_server(("127.0.0.1", 0)) as taken:
        port = taken.getsockname()[1]
        with pytest.raises(TactophoneError, match="choose another address"):
            watch("none", f"127.0.0.1:{port}")


@pytest.mark.realtime
def test_it_serves_before_there_is_a_run_and_not_after_its_end() -> None:
    with watch("none") as page:
        assert page.access.private
        with urllib.request.urlopen(page.url) as answer:
            assert answer.status == 200
    with pytest.raises(urllib.error.URLError):
        urllib.request.urlopen(page.url)


@pytest.mark.realtime
def test_it_ends_when_its_parent_is_killed() -> None:
    program = (
        "import os, signal, sys\n"
        "from tactophone.faces.web.server import watch\n"
        "if __name__ == '__main__':\n"
        "    print(watch('none').url, flush=True)\n"
        "    sys.stdin.read()\n"
        "    os.kill(os.getpid(), signal.SIGKILL)\n"
    )
    with subprocess.Popen(
        [sys.executable, "-c", program], stdin=-1, stdout=-1, text=True
    ) as process:
        assert process.stdout
        url = process.stdout.readline().strip()
        urllib.request.urlopen(url).close()
        process.communicate()
    until = time.monotonic() + 5
    while time.monotonic() < until:
        try:
            urllib.request.urlopen(url, timeout=1).close()
        except OSError:
            return
        time.sleep(0.05)
    pytest.fail("the page outlived its parent by five seconds")
