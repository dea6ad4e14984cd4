import threading
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import soundfile

from tactophone.core.errors import DeviceError
from tactophone.core.recordings import sound_file
from tactophone.core.types import FloatArray
from tactophone.live.audio.actuator import (
    Actuator,
    ClockedDevice,
    Render,
    clocked_hand_actuator,
    jack_hand_actuator,
    portaudio_hand_actuator,
)
from tactophone.live.audio.dummy import DummyServer
from tactophone.live.audio.jack import JackClient

from . import actuator_contract as contract
from .test_jack import eventually


def jack_actuator(
    render: Render, *, port: str = "system:playback_1", **kwargs: str
) -> Actuator:
    return jack_hand_actuator(
        lambda outs: render(outs[0]), ports={"vibration": port}, **kwargs
    )


def portaudio_actuator(render: Render, *, device: str) -> Actuator:
    return portaudio_hand_actuator(
        lambda outs: render(outs[0]), device=device, channels=[1]
    )


def clocked_actuator(
    render: Render,
    *,
    period: int = 128,
    path: Path | None = None,
    resume: bool = False,
) -> Actuator:
    return clocked_hand_actuator(
        lambda outs: render(outs[0]),
        fingers=1,
        period=period,
        path=path,
        resume=resume,
    )


@pytest.mark.realtime
@pytest.mark.parametrize("promise", contract.ALL)
def test_jack_keeps_the_contract(promise: Callable, jack_server: DummyServer) -> None:
    promise(lambda render: jack_actuator(render, server=jack_server.name))


@pytest.mark.realtime
@pytest.mark.parametrize("promise", contract.ALL)
@pytest.mark.usefixtures("portaudio")
def test_portaudio_keeps_the_contract(promise: Callable) -> None:
    promise(lambda render: portaudio_actuator(render, device="system"))


@pytest.mark.realtime
@pytest.mark.usefixtures("portaudio")
def test_portaudio_plays_silence_while_the_render_fails(
    jack_server: DummyServer,
) -> None:
    heard: list[float] = []
    render = contract.Counting()
    render.level = 0.5
    with portaudio_actuator(render, device="system"):
        probe = JackClient(
            "probe", None, inputs={}, outputs={}, server=jack_server.name
        )
        probe.open()
        [played] = [
            port.name for port in probe.ports() if port.is_output and not port.physical
        ]
        probe.close()
        listener = JackClient(
            "listener",
            lambda inputs, _: heard.append(float(np.abs(inputs[0]).max())),
            inputs={"in": played},
            outputs={},
            server=jack_server.name,
        )
        listener.open()
        try:
            assert eventually(lambda: heard[-1:] == [0.5])
            render.fails = True
            assert eventually(lambda: heard[-1:] == [0.0])
            begun = len(heard)
            assert eventually(lambda: len(heard) > begun + 10)
            assert set(heard[begun:]) == {0.0}
        finally:
            listener.close()


@pytest.mark.parametrize("promise", contract.ALL)
def test_no_device_keeps_the_contract(promise: Callable) -> None:
    promise(clocked_actuator)


@pytest.mark.parametrize("promise", contract.ALL)
def test_a_file_keeps_the_contract(promise: Callable, tmp_path: Path) -> None:
    promise(lambda render: clocked_actuator(render, path=tmp_path / "vibration.wav"))


def test_the_file_holds_what_was_rendered_and_silence_for_what_failed(
    tmp_path: Path,
) -> None:
    render = contract.Counting()
    render.level = 0.25
    with clocked_actuator(render, period=64, path=tmp_path / "vibration.wav"):
        render.wait(3)
        render.fails = True
        render.wait(3)
    waveform, rate = soundfile.read(tmp_path / "vibration.wav", dtype="float32")
    # It tells when something was touched.
    assert (tmp_path / "vibration.wav").stat().st_mode & 0o777 == 0o600
    assert rate == 48_000
    assert len(waveform) == 64 * len(render.sizes)
    assert set(np.unique(waveform)) == {0.0, 0.25}
    assert waveform[-1] == 0.0


def test_a_file_whose_name_is_no_utf8_is_written(tmp_path: Path) -> None:
    render = contract.Counting()
    with clocked_actuator(render, period=64, path=tmp_path / "v\udcff.wav"):
        render.wait(1)
    (written,) = tmp_path.iterdir()
    assert written.stat().st_size > 44


def test_a_file_that_holds_no_vibration_is_left_as_it_is(tmp_path: Path) -> None:
    """A mistyped name emptied a file of settings, or a log of hours."""
    path = tmp_path / "own.toml"
    path.write_text("[rendering]")
    with (
        pytest.raises(DeviceError, match=r"ends in \.wav"),
        clocked_actuator(print, path=path),
    ):
        pass
    assert path.read_text() == "[rendering]"


@pytest.mark.parametrize("name", ["v.wav", "v.w64"])
def test_a_vibration_goes_on_where_a_process_was_killed(
    name: str, tmp_path: Path
) -> None:
    render = contract.Counting()
    render.level = 0.25
    path, left = tmp_path / name, tmp_path / f"left-{name}"
    with clocked_actuator(render, period=64, path=path):
        render.wait(3)
        left.write_bytes(path.read_bytes())  # as a kill would leave it
    before = len(soundfile.read(left)[0])
    assert before >= 64
    render = contract.Counting()
    render.level = 0.5
    with clocked_actuator(render, period=64, path=left, resume=True):
        render.wait(3)
    waveform, _ = soundfile.read(left, dtype="float32")
    assert len(waveform) == before + 64 * len(render.sizes)
    assert set(waveform[:before]) == {0.25}
    assert set(waveform[before:]) == {0.5}


def test_a_vibration_ends_in_words_where_a_wav_file_is_full(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """What lay beyond 4 GB was written, and nobody could read it."""
    monkeypatch.setattr(sound_file, "LARGEST_WAV", 4 * 200)
    for name in ("v.wav", "v.w64"):
        render = contract.Counting()
        device = ClockedDevice(
            lambda _, outs, render=render: render(outs[0]),
            period=64,
            path=tmp_path / name,
        )
        device.open()
        render.wait(6)
        device.close()
        size = len(soundfile.read(tmp_path / name)[0])
        full = name == "v.wav"
        assert size == (192 if full else 64 * len(render.sizes))
        assert (".w64 for a longer run" in device.fault) == full


def test_what_a_killed_process_had_not_begun_begins(tmp_path: Path) -> None:
    path = tmp_path / "v.wav"
    path.touch()
    render = contract.Counting()
    with clocked_actuator(render, path=path, resume=True):
        render.wait(1)
    assert len(soundfile.read(path)[0]) >= 128


def test_the_vibration_that_another_run_writes_is_left_to_it(tmp_path: Path) -> None:
    path = tmp_path / "vibration.wav"
    render = contract.Counting()
    with clocked_actuator(render, period=64, path=path):
        with (
            pytest.raises(DeviceError, match="another run is writing it"),
            clocked_actuator(print, path=path),
        ):
            pass
        render.wait(1)
    assert len(soundfile.read(path)[0]) >= 64


def test_the_waveform_keeps_its_length_through_a_stall_or_counts_what_is_lost(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    now, periods = [0.0], [0]

    def stall(_: object, timeout: float) -> bool:
        """Pass the time at once, and stand still for 1 s, then for 3 s."""
        now[0] += timeout + {100: 1.0, 1000: 3.0}.get(periods[0], 0.0)
        periods[0] += 1
        return periods[0] > 2000

    monkeypatch.setattr(threading.Event, "wait", stall)
    monkeypatch.setattr("tactophone.live.audio.actuator.time.monotonic", lambda: now[0])
    device = ClockedDevice(lambda ins, outs: None, period=480)
    device._file = None
    device._run()
    assert device.xruns == 300
    assert periods[0] == pytest.approx(now[0] / 0.01 - device.xruns, abs=2)


def test_a_file_that_cannot_be_written_is_an_error(tmp_path: Path) -> None:
    with (
        pytest.raises(DeviceError, match="cannot be written"),
        clocked_actuator(print, path=tmp_path / "no" / "x.wav"),
    ):
        pass


@pytest.mark.realtime
def test_a_missing_port_lists_the_candidates(jack_server: DummyServer) -> None:
    actuator = jack_actuator(print, port="system:playback_9", server=jack_server.name)
    candidates = "system:playback_1, system:playback_2"
    with (
        pytest.raises(
            DeviceError, match=rf"no JACK port system:playback_9.*{candidates}"
        ),
        actuator,
    ):
        pass


def test_no_server_says_how_to_start_one() -> None:
    with (
        pytest.raises(DeviceError, match="jackd -R"),
        jack_actuator(print, server="tactophone-none"),
    ):
        pass


@pytest.mark.realtime
def test_a_server_of_another_rate_is_refused() -> None:
    with (
        DummyServer(128, sample_rate=44_100) as server,
        pytest.raises(DeviceError, match="44100 Hz, but 48000"),
        jack_actuator(print, server=server.name),
    ):
        pass


@pytest.mark.realtime
@pytest.mark.usefixtures("portaudio")
def test_portaudio_lists_what_it_has() -> None:
    with pytest.raises(
        DeviceError, match=r"0 PortAudio devices.*'telephone'.*0 system \(JACK"
    ):
        portaudio_actuator(print, device="telephone").__enter__()


@pytest.mark.realtime
def test_a_render_that_fails_is_silent_at_the_jack_port(
    jack_server: DummyServer,
) -> None:
    peaks: list[float] = []

    def listen(inputs: list[FloatArray], _: list[FloatArray]) -> None:
        peaks.append(float(np.abs(inputs[0]).max()))

    render = contract.Counting()
    render.level = 0.5
    with jack_actuator(render, port="-", server=jack_server.name, name="operator"):
        wire = {"in": "operator:vibration"}
        listener = JackClient(
            "listener", listen, inputs=wire, outputs={}, server=jack_server.name
        )
        listener.open()
        render.wait(10)
        assert peaks[-1] == 0.5
        render.fails = True
        render.wait(10)
        listener.close()
    assert peaks[-1] == 0.0
