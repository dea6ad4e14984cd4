"""Lists the sound devices, and whether each is suitable for two microphones or for an
actuator."""

import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass

from tactophone.core.errors import DeviceError
from tactophone.core.microphones import MICROPHONES
from tactophone.core.types import LIVE_SAMPLE_RATE
from tactophone.live.audio.jack import JackClient, is_pipewire
from tactophone.live.audio.portaudio import PortAudioDevice, devices

SURVEY_TOO_SLOW = 0.02
"""Delay of a device in s above which it is called slow: a third of the delay that is
noticed in texture."""

DUALSENSE = re.compile(r"dual[ _-]?sense|wireless controller", re.IGNORECASE)
"""Names under which ALSA, PipeWire and JACK list Sony's DualSense gamepad over USB."""

DUALSENSE_CHANNEL = 3
"""Channel of a DualSense's left voice coil, counted from 1: the front pair of its four
channels is the headphone jack, the rear pair the two voice coils."""

_DUALSENSE_NOTE = "; a DualSense: two voice coils that play any waveform"


@dataclass(frozen=True, slots=True)
class SurveyedDevice:
    """A device, or a sound system that is not available."""

    system: str
    name: str
    inputs: int
    outputs: int
    sample_rate: int
    microphones: str
    """Why it is unsuitable for microphones; empty when it is suitable."""
    actuator: str
    """Why it is unsuitable for an actuator; empty when it is suitable."""
    settings: tuple[str, ...] = ()
    """Assignments for ``--set`` that use it."""
    note: str = ""


def survey(*, jack_server: str = "") -> list[SurveyedDevice]:
    return [_jack(jack_server), *_portaudio()]


def _jack(server: str) -> SurveyedDevice:
    client = JackClient("tactophone-survey", None, inputs={}, outputs={}, server=server)
    try:
        client.open()
    except DeviceError as error:
        return _missing("JACK", server or "default server", str(error))
    # A sink or source that is no sound card, as PipeWire offers without one, is better
    # than none.
    ports = [port for port in client.ports() if port.physical] or client.ports()
    rate = client.sample_rate
    period = client.period
    coil = dualsense_port([port.name for port in client.ports() if not port.is_output])
    client.close()
    system = "JACK by PipeWire" if is_pipewire() else "JACK"
    outputs = [port.name for port in ports if port.is_output]
    inputs = [port.name for port in ports if not port.is_output]
    microphones = [
        f"capture.{name}={port}"
        for name, port in zip(MICROPHONES, outputs, strict=False)
    ]
    actuators = [f"output.port={port}" for port in inputs[:1]]
    if coil:
        actuators = [f"output.port={coil}", "rendering.profile=dualsense"]
    note = f"periods of {period} samples, {1000 * period / rate:.1f} ms"
    return SurveyedDevice(
        system,
        server or "default server",
        len(outputs),
        len(inputs),
        rate,
        microphones=_rate_problem(rate) or _microphones_problem(len(outputs)),
        actuator=_rate_problem(rate) or ("" if inputs else "no outputs"),
        settings=(
            "capture.source=jack",
            *microphones,
            "output.actuator=jack",
            *actuators,
        ),
        note=note + (_DUALSENSE_NOTE if coil else ""),
    )


def _portaudio() -> Iterator[SurveyedDevice]:
    try:
        found = devices()
    except DeviceError as error:
        yield _missing("PortAudio", "", str(error))
        return
    if not found:
        yield _missing("PortAudio", "", "no devices: connect a sound card")
    yield from map(assess, found)


def assess(device: PortAudioDevice) -> SurveyedDevice:
    """Return what a PortAudio device is suitable for, and how to use it."""
    rate = round(device.sample_rate)
    latency = max(
        device.input_latency * bool(device.inputs),
        device.output_latency * bool(device.outputs),
    )
    note = f"adds {1000 * latency:.1f} ms"
    if latency > SURVEY_TOO_SLOW:
        note = f"slow: adds {1000 * latency:.0f} ms"
    settings: tuple[str, ...] = (
        f"capture.device={device.index}",
        f"output.device={device.index}",
    )
    if DUALSENSE.search(device.name) and device.outputs > DUALSENSE_CHANNEL:
        note += _DUALSENSE_NOTE
        settings = (
            "output.actuator=portaudio",
            f"output.device={device.index}",
            f"output.channel={DUALSENSE_CHANNEL}",
            "rendering.profile=dualsense",
        )
    if device.system.startswith("JACK"):
        note = "use source jack instead"
    return SurveyedDevice(
        f"PortAudio, {device.system}",
        device.name,
        device.inputs,
        device.outputs,
        rate,
        microphones=_microphones_problem(device.inputs),
        actuator="" if device.outputs else "no outputs",
        settings=settings,
        note=note,
    )


def dualsense_port(names: Sequence[str]) -> str:
    """Return the port of a DualSense's left voice coil among playback ports; empty
    without one."""
    ports = [name for name in names if DUALSENSE.search(name)]
    # PipeWire calls the ports rear left (surround profile) or AUX2 (Pro Audio); other
    # servers number them.
    return next((name for name in ports if re.search(r"(_RL|AUX2|_3)$", name)), "")


def _rate_problem(rate: int) -> str:
    if rate == LIVE_SAMPLE_RATE:
        return ""
    return f"runs at {rate} Hz, needs {LIVE_SAMPLE_RATE}"


def _microphones_problem(inputs: int) -> str:
    if inputs == 1:
        return "one input: only with a one-channel model (capture.air empty)"
    return "" if inputs else "no inputs"


def _missing(system: str, name: str, why: str) -> SurveyedDevice:
    return SurveyedDevice(system, name, 0, 0, 0, microphones=why, actuator=why)
