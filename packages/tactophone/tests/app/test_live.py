"""`open_live`: steps and callbacks of live sound, how they end, and what they need."""

import subprocess
import sys
import threading
from collections.abc import Iterator
from pathlib import Path

import numpy as np
import pytest
import soundfile

import tactophone
from tactophone.core.extras import WITHOUT_WHEEL
from tactophone.core.types import AudioBlock
from tactophone.live.audio.sources import LiveSource

RATE = 48_000


class Unplugged:
    """A device that delivers nothing."""

    xruns = 0
    fault = ""
    sample_rate = RATE

    def open(self) -> None:
        pass

    def close(self) -> None:
        pass

    def revive(self) -> None:
        pass


class Steady:
    """A source of noise without end."""

    sample_rate, channels = RATE, 1

    def __init__(self) -> None:
        self.entered = self.left = False

    def __enter__(self) -> "Steady":
        self.entered = True
        return self

    def __exit__(self, *_: object) -> None:
        self.left = True

    def __iter__(self) -> Iterator[AudioBlock]:
        noise = (
            np.random.default_rng(0).normal(scale=0.1, size=(480, 1)).astype(np.float32)
        )
        for start in range(0, 1 << 40, 480):
            yield AudioBlock(noise, RATE, start)


def silent() -> LiveSource:
    return LiveSource(lambda process: Unplugged(), channels=1)  # type: ignore[arg-type,return-value]


def test_stop_ends_a_source_that_delivers_nothing() -> None:
    run = tactophone.open_live(silent()).start(lambda step: None)
    ended = threading.Thread(target=run.stop, daemon=True)
    ended.start()
    ended.join(5)
    assert not ended.is_alive()


def test_leaving_the_block_ends_a_source_that_delivers_nothing() -> None:
    with tactophone.open_live(silent()).start(lambda step: None) as run:
        assert not run.wait(0.01)
    assert run.wait(0)


@pytest.mark.parametrize("how", ["stop", "exit", "wait"])
def test_what_a_callback_raises_is_raised_where_the_run_ends(how: str) -> None:
    called = threading.Event()

    def fail(step: tactophone.PipelineStep) -> None:
        called.set()
        raise ZeroDivisionError("in the callback")

    source = Steady()
    run = tactophone.open_live(source).start(fail)
    assert called.wait(10)
    with pytest.raises(ZeroDivisionError, match="in the callback"):
        {"stop": run.stop, "wait": lambda: run.wait(10), "exit": run.__exit__}[how]()
    assert source.left
    run.stop()  # told once


def test_a_run_of_a_file_can_be_waited_for(tmp_path: Path) -> None:
    soundfile.write(tmp_path / "a.wav", np.zeros((RATE // 4, 2)), RATE)
    ends: list[float] = []
    with tactophone.open_live(f"file:{tmp_path / 'a.wav'}").start(
        lambda step: ends.append(step.block.end)
    ) as run:
        assert run.wait(10)
    # Where the machine is held up, time passes for a file as for a microphone.
    assert ends[-1] >= RATE // 4


def test_stop_leaves_the_source_once_the_callback_has_returned() -> None:
    source, called = Steady(), threading.Event()
    run = tactophone.open_live(source).start(lambda step: called.set())
    assert called.wait(10)
    run.stop()
    assert (source.entered, source.left) == (True, True)


HIDE = """
import sys
class Hidden:
    def find_spec(self, name, path=None, target=None):
        if name.split(".")[0] in {names!r}:
            raise ModuleNotFoundError(f"No module named {{name!r}}", name=name)
sys.meta_path.insert(0, Hidden())
import importlib.util
found = importlib.util.find_spec
def find_spec(name, package=None):
    return None if name in {names!r} else found(name, package)
importlib.util.find_spec = find_spec
import tactophone
"""


def without(names: tuple[str, ...], code: str) -> str:
    """Run code where some modules are not installed; return what it prints."""
    command = [sys.executable, "-c", HIDE.format(names=names) + code]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    return done.stdout


LINK = ("pylibsrtp", "OpenSSL", "opuslib_next", "samplerate")


@pytest.mark.slow
def test_live_sound_needs_no_library_of_the_link(tmp_path: Path) -> None:
    soundfile.write(tmp_path / "a.wav", np.zeros((RATE // 4, 2)), RATE)
    code = f"""
print(len(list(tactophone.open_live("file:{tmp_path / "a.wav"}"))))
print(next(iter(tactophone.open_live("finger"))).block.size)
"""
    files, size = without(LINK, code).split()
    assert int(files) > 0 < int(size)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("source", "names", "requirement"),
    [
        ("jack", ("jack",), "tactophone[jack]"),
        ("portaudio:0", ("sounddevice",), "tactophone[portaudio]"),
        ("ros:/sound", ("cyclonedds",), "tactophone[ros]"),
        ("finger", ("numba",), "tactophone-lab[sim]"),
    ],
)
def test_a_missing_extra_names_its_pip_install(
    source: str, names: tuple[str, ...], requirement: str
) -> None:
    code = f"""
try:
    list(tactophone.open_live("{source}"))
except tactophone.TactophoneError as error:
    print(error)
"""
    no_wheel = any(sys.version_info >= WITHOUT_WHEEL.get(name, (4,)) for name in names)
    wanted = "use Python 3.11 to 3.13" if no_wheel else f"pip install '{requirement}'"
    assert wanted in without(names, code)


def test_a_figure_without_its_extra_names_its_pip_install() -> None:
    code = """
try:
    tactophone.Table((), ()).plot()
except tactophone.ConfigError as error:
    print(error)
"""
    assert "pip install 'tactophone[plot]'" in without(("matplotlib",), code)


@pytest.mark.slow
def test_the_public_face_loads_nothing_of_the_command_line(tmp_path: Path) -> None:
    soundfile.write(tmp_path / "a.wav", np.zeros((RATE // 4, 2)), RATE)
    code = f"""
import sys, tactophone
for name in tactophone.__all__:
    getattr(tactophone, name)
list(tactophone.open_live("file:{tmp_path / "a.wav"}"))
tactophone.classify("{tmp_path / "a.wav"}")
unwanted = ("tactophone.cli", "argparse", "rich")
print([name for name in sys.modules if name.startswith(unwanted)])
"""
    done = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True
    )
    assert done.stdout.strip() == "[]"


def test_whoever_moves_the_robot_says_so() -> None:
    live = tactophone.open_live(Steady())
    steps = iter(live)
    assert not next(steps).block.moving
    live.moving(True)
    assert next(steps).block.moving
    live.moving(False)
    assert not next(steps).block.moving
