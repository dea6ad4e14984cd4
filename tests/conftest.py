"""Fixtures for all tests."""

import contextlib
import os
import signal
import sys
from collections.abc import Iterator
from pathlib import Path

import hypothesis
import pytest

from tactophone.live.audio.dummy import DummyServer

# A shell makes what it starts in the background ignore Ctrl+C, and programs under test would inherit that.
signal.signal(signal.SIGINT, signal.default_int_handler)

# The same examples in every run, as a change must not fail for what it did not touch; `make fuzz` looks for new ones.
hypothesis.settings.register_profile("fixed", derandomize=True, deadline=None)
hypothesis.settings.register_profile("random", max_examples=1000, deadline=None)
hypothesis.settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "fixed"))


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Start slow tests first, so that two workers end together."""
    items.sort(key=lambda item: item.get_closest_marker("slow") is None)


@pytest.fixture(scope="session")
def recordings() -> Path:
    """The folder of real recordings; a test that needs it is skipped where there is none."""
    folder = os.environ.get("TACTOPHONE_RECORDINGS", "")
    if not folder or not Path(folder).is_dir():
        pytest.skip("no real recordings: set TACTOPHONE_RECORDINGS to their folder")
    return Path(folder)


@pytest.fixture(autouse=True)
def _subnormal_numbers() -> Iterator[None]:
    """Undo a processor mode set by training (flush subnormals to zero), as other tests use such numbers."""
    yield
    if torch := sys.modules.get("torch"):
        torch.set_flush_denormal(False)


@pytest.fixture
def jack_server() -> Iterator[DummyServer]:
    """A JACK server of the test's own, with no sound card."""
    with DummyServer(128) as server:
        yield server


@pytest.fixture
def portaudio(jack_server: DummyServer, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """PortAudio on the test's own JACK server; it must forget that server before the server ends, or it aborts."""
    monkeypatch.setenv("JACK_DEFAULT_SERVER", jack_server.name)
    monkeypatch.setenv("JACK_NO_START_SERVER", "1")
    sounddevice = pytest.importorskip("sounddevice")
    with contextlib.suppress(sounddevice.PortAudioError):
        sounddevice._terminate()
    sounddevice._initialize()
    yield
    sounddevice._terminate()
    monkeypatch.setenv("JACK_DEFAULT_SERVER", "tactophone-none")
    sounddevice._initialize()
