"""Resonance and band of an actuator, from a sweep through a known resonator."""

import math
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import lfilter

from tactophone.app.sweep import SweepRecorder, fit, sweep
from tactophone.cli import main
from tactophone.cli.devices import as_toml
from tactophone.core.errors import DeviceError
from tactophone.core.settings import read_settings
from tactophone.core.types import FloatArray
from tactophone.live.audio.dummy import DummyServer
from tactophone.live.audio.jack import JackClient

RATE = 48_000


def through(
    sound: FloatArray,
    *,
    resonance: float,
    quality: float,
    delay: float = 0.04,
    noise: float = 1e-4,
) -> FloatArray:
    """A band-pass of second order, a sound card's delay, and noise."""
    omega = 2 * math.pi * resonance / RATE
    alpha = math.sin(omega) / (2 * quality)
    filtered = lfilter(
        [alpha, 0, -alpha], [1 + alpha, -2 * math.cos(omega), 1 - alpha], sound
    )
    delayed = np.concatenate([np.zeros(round(delay * RATE)), filtered])[: len(sound)]
    return (
        delayed + 1e-4 * np.random.default_rng(1).standard_normal(len(sound))
    ).astype(np.float32)


@pytest.mark.parametrize("delay", [0.005, 0.1])
@pytest.mark.parametrize(
    ("resonance", "quality"), [(65.0, 1.5), (168.0, 3.0), (235.0, 8.0)]
)
def test_resonance_and_band_are_those_of_the_resonator(
    resonance: float, quality: float, delay: float
) -> None:
    found = fit(through(sweep(0.2), resonance=resonance, quality=quality, delay=delay))
    assert found.resonance == pytest.approx(resonance, rel=0.03)
    # |H| = 1 / sqrt(1 + Q^2 (f/f0 - f0/f)^2) is -10 dB where the bracket is 3/Q.
    half = 1.5 / quality
    low, high = (resonance * (math.hypot(half, 1) + sign * half) for sign in (-1, 1))
    assert found.lowest == pytest.approx(max(low, 38.5), rel=0.08)
    assert found.highest == pytest.approx(min(high, 727.0), rel=0.08)


def test_noise_alone_is_refused_with_what_to_do() -> None:
    with pytest.raises(DeviceError, match="press the microphone on the actuator"):
        fit(
            np.random.default_rng(1).standard_normal(len(sweep(0.2))).astype(np.float32)
        )


def test_the_file_is_read_as_settings(tmp_path: Path) -> None:
    path = tmp_path / "actuator.toml"
    path.write_text(as_toml(fit(through(sweep(0.2), resonance=168.0, quality=3.0))))
    actuator = read_settings(path).actuator
    assert actuator.resonance == pytest.approx(168.0, rel=0.03)
    assert actuator.lowest < actuator.resonance < actuator.highest
    assert actuator.response


def test_the_sweep_stays_below_its_amplitude_and_is_played_to_its_end() -> None:
    waveform = sweep(0.2)
    assert np.abs(waveform).max() <= 0.2
    recorder = SweepRecorder(waveform)
    played = []
    for _ in range(len(waveform) // 128 + 3):
        out = np.ones(128, np.float32)
        recorder.play(out)
        played.append(out)
    sound = np.concatenate(played)
    assert np.array_equal(sound[: len(waveform)], waveform)
    assert not sound[len(waveform) :].any()


@pytest.mark.parametrize("amplitude", ["0", "0.6", "nan"])
def test_an_amplitude_over_the_default_ceiling_is_refused(
    amplitude: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["devices", "measure", "--amplitude", amplitude]) == 1
    assert "must be over 0 to 0.5 of full drive" in capsys.readouterr().err


def test_the_sweep_stays_below_the_ceiling_of_the_machine(
    monkeypatch: pytest.MonkeyPatch,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """It was played at 0.2, four times a ceiling of 0.05."""
    played: list[FloatArray] = []

    def record(recorder: SweepRecorder, *_: object) -> FloatArray:
        played.append(np.zeros(8 * RATE, np.float32))
        recorder.play(played[0])
        return through(played[0], resonance=168.0, quality=3.0)

    monkeypatch.setattr(SweepRecorder, "run", record)
    command = ["devices", "measure", "--out", str(tmp_path / "actuator.toml")]
    assert main([*command, "--set", "rendering.ceiling=0.05"]) == 0
    assert 0.04 < np.abs(played[0]).max() <= 0.05
    assert "at 0.05 of full drive (the ceiling)" in capsys.readouterr().err


@pytest.mark.realtime
def test_the_verb_measures_through_virtual_sound_cards(tmp_path: Path) -> None:
    """JACK's dummy server, with a resonator between the actuator's port and the
    microphone's."""
    omega, quality = 2 * math.pi * 150.0 / RATE, 4.0
    alpha = math.sin(omega) / (2 * quality)
    state = np.zeros(2)

    def resonate(inputs: list[FloatArray], outputs: list[FloatArray]) -> None:
        coefficients = [alpha, 0, -alpha], [1 + alpha, -2 * math.cos(omega), 1 - alpha]
        outputs[0][:], state[:] = lfilter(*coefficients, inputs[0], zi=state)

    with DummyServer(512) as server:
        resonator = JackClient(
            "resonator",
            resonate,
            inputs={"in": ""},
            outputs={"out": ""},
            server=server.name,
        )
        resonator.open()
        try:
            command = [
                "devices",
                "measure",
                "--out",
                str(tmp_path / "actuator.toml"),
                "--actuator",
                "jack:resonator:in",
                "--set",
                f"process.jack_server={server.name}",
                "--set",
                "capture.contact=resonator:out",
            ]
            assert main(command) == 0
        finally:
            resonator.close()
    actuator = read_settings(tmp_path / "actuator.toml").actuator
    assert actuator.resonance == pytest.approx(150.0, rel=0.03)
    assert actuator.lowest < 150 < actuator.highest
