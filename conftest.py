"""Fixtures for all tests."""

import contextlib
import os
import signal
import sys
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import hypothesis
import pytest

import tests  # noqa: F401  # one namespace of three folders, before pytest makes its own
from tactophone.live.audio.dummy import DummyServer
from tests import own_memory
from tests.promises import STRICT, Named, Unchecked

ROOT = Path(__file__).parent

# Programs that tests start import helpers from `tests` too.
os.environ["PYTHONPATH"] = os.pathsep.join(
    [
        *map(str, (ROOT, *sorted(ROOT.glob("packages/tactophone*")))),
        *filter(None, [os.environ.get("PYTHONPATH")]),
    ]
)

# Verbs under test that are pages would open them on a developer's screen.
os.environ["BROWSER"] = "true"

# A shell makes what it starts in the background ignore Ctrl+C, and programs under test
# would inherit that.
signal.signal(signal.SIGINT, signal.default_int_handler)

own_memory.separate()

# The same examples in every run, as a change must not fail for what it did not touch;
# `make fuzz` looks for new ones.
hypothesis.settings.register_profile("fixed", derandomize=True, deadline=None)
hypothesis.settings.register_profile("random", max_examples=1000, deadline=None)
hypothesis.settings.load_profile(os.environ.get("HYPOTHESIS_PROFILE", "fixed"))


# Programs that make the data need what the tests do not.
collect_ignore_glob = ["tests/data/*", "integrations/*/tests/data/*"]


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Start slow tests first, so that two workers end together."""
    items.sort(key=lambda item: item.get_closest_marker("slow") is None)


MOST_RERUNS = 2
"""Of all sessions of one `make test`: one more, and it fails, as a flake that is
repeated each time hides a fault."""

_rerun: list[str] = []

_unchecked = Unchecked(Named.read(ROOT / "docs"))


def pytest_runtest_logreport(report: pytest.TestReport) -> None:
    """Note what had to be repeated; with several workers, where their reports come
    together."""
    if "PYTEST_XDIST_WORKER" in os.environ:
        return
    if report.outcome == "rerun":
        _rerun.append(report.nodeid)
    _unchecked.note(report)


def pytest_collectreport(report: pytest.CollectReport) -> None:
    """Note a file of promised tests that was skipped as a whole."""
    if "PYTEST_XDIST_WORKER" not in os.environ:
        _unchecked.note(report)


def pytest_sessionfinish(session: pytest.Session) -> None:
    """Fail at the third test that had to be repeated, over all sessions that write into
    one list; and at a promise that was not checked, where all must be."""
    if (
        _unchecked.skipped
        and os.environ.get(STRICT)
        and session.exitstatus
        in (pytest.ExitCode.OK, pytest.ExitCode.NO_TESTS_COLLECTED)
    ):
        session.exitstatus = pytest.ExitCode.TESTS_FAILED
    if (
        not (path := os.environ.get("TACTOPHONE_RERUN_LIST"))
        or "PYTEST_XDIST_WORKER" in os.environ
    ):
        return
    with Path(path).open("a+", encoding="utf-8") as file:
        file.writelines(f"{name}\n" for name in _rerun)
        file.seek(0)
        if len(file.readlines()) > MOST_RERUNS and _rerun and not session.exitstatus:
            session.exitstatus = pytest.ExitCode.TESTS_FAILED


def pytest_terminal_summary(terminalreporter: Any) -> None:
    """Say which promises were not checked, and how many reruns were needed."""
    if _unchecked.skipped:
        terminalreporter.write_line("promises that no test checked here:")
        for line in _unchecked.lines():
            terminalreporter.write_line(line)
    if _rerun:
        terminalreporter.write_line(
            f"{len(_rerun)} reruns were needed; `make test` fails at "
            f"{MOST_RERUNS + 1} in all:"
        )
        for name in _rerun:
            terminalreporter.write_line(f"  {name}")


@pytest.fixture(scope="session")
def recordings() -> Path:
    """The folder of real recordings; a test that needs it is skipped where there is
    none."""
    folder = os.environ.get("TACTOPHONE_RECORDINGS", "")
    if not folder or not Path(folder).is_dir():
        pytest.skip("no real recordings: set TACTOPHONE_RECORDINGS to their folder")
    return Path(folder)


@pytest.fixture(autouse=True)
def _subnormal_numbers() -> Iterator[None]:
    """Undo a processor mode set by training (flush subnormals to zero), as other tests
    use such numbers."""
    yield
    if torch := sys.modules.get("torch"):
        torch.set_flush_denormal(False)


@pytest.fixture
def jack_server() -> Iterator[DummyServer]:
    """A JACK server of the test's own, with no sound card."""
    with DummyServer(128) as server:
        yield server


@pytest.fixture
def portaudio(
    jack_server: DummyServer, monkeypatch: pytest.MonkeyPatch
) -> Iterator[None]:
    """PortAudio on the test's own JACK server; it must forget that server before the
    server ends, or it aborts."""
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
