"""Lists the sound devices, and whether each is suitable for two microphones or for an actuator."""

from collections.abc import Iterator
from dataclasses import dataclass

from tactophone.devices.jack import JackClient, silent
from tactophone.devices.portaudio import PortAudioDevice, devices
from tactophone.errors import DeviceError
from tactophone.types import LIVE_SAMPLE_RATE

TOO_SLOW = 0.02
"""Delay of a device in s above which it is called slow: a third of what is noticed in texture."""


@dataclass(frozen=True, slots=True)
class SurveyedDevice:
    """A device, or a sound system that is not available.

    Parameters
    ----------
    settings
        Assignments for ``--set`` that use it.
    microphones, actuator
        Why it is unsuitable; empty when it is suitable.
    note
        Further remarks.
    """

    system: str
    name: str
    inputs: int
    outputs: int
    sample_rate: int
    microphones: str
    actuator: str
    settings: tuple[str, ...] = ()
    note: str = ""


def survey(*, jack_server: str = "") -> list[SurveyedDevice]:
    """Return the JACK server and all devices that PortAudio finds."""
    return [_jack(jack_server), *_portaudio()]


def _jack(server: str) -> SurveyedDevice:
    client = JackClient("tactophone-survey", silent, inputs={}, outputs={}, server=server)
    try:
        client.open()
    except DeviceError as error:
        return _missing("JACK", server or "default server", str(error))
    ports = [port for port in client.ports() if port.physical]
    rate, period = client.sample_rate, client.period
    client.close()
    outputs = [port.name for port in ports if port.is_output]
    inputs = [port.name for port in ports if not port.is_output]
    microphones = [f"capture.{name}={port}" for name, port in zip(("contact", "air"), outputs, strict=False)]
    return SurveyedDevice(
        "JACK",
        server or "default server",
        len(outputs),
        len(inputs),
        rate,
        microphones=_microphones_problem(len(outputs), rate),
        actuator=_actuator_problem(len(inputs), rate),
        settings=(
            "capture.source=jack",
            *microphones,
            "output.actuator=jack",
            *(f"output.port={port}" for port in inputs[:1]),
        ),
        note=f"periods of {period} samples, {1000 * period / rate:.1f} ms",
    )


def _portaudio() -> Iterator[SurveyedDevice]:
    try:
        found = devices()
    except DeviceError as error:
        yield _missing("PortAudio", "", str(error))
        return
    if not found:
        yield _missing("PortAudio", "", "no devices: connect a sound card")
    yield from map(_assess, found)


def _assess(device: PortAudioDevice) -> SurveyedDevice:
    rate = round(device.sample_rate)
    latency = max(device.input_latency * bool(device.inputs), device.output_latency * bool(device.outputs))
    slow = f"slow: adds {1000 * latency:.0f} ms" if latency > TOO_SLOW else f"adds {1000 * latency:.1f} ms"
    return SurveyedDevice(
        f"PortAudio, {device.system}",
        device.name,
        device.inputs,
        device.outputs,
        rate,
        microphones=_microphones_problem(device.inputs, LIVE_SAMPLE_RATE),
        actuator=_actuator_problem(device.outputs, LIVE_SAMPLE_RATE),
        settings=(f"capture.device={device.index}", f"output.device={device.index}"),
        note="use source jack instead" if device.system.startswith("JACK") else slow,
    )


def _microphones_problem(inputs: int, rate: int) -> str:
    if rate != LIVE_SAMPLE_RATE:
        return f"runs at {rate} Hz, needs {LIVE_SAMPLE_RATE}"
    if inputs == 1:
        return "one input: only with a one-channel model (capture.air empty)"
    return "" if inputs else "no inputs"


def _actuator_problem(outputs: int, rate: int) -> str:
    if rate != LIVE_SAMPLE_RATE:
        return f"runs at {rate} Hz, needs {LIVE_SAMPLE_RATE}"
    return "" if outputs else "no outputs"


def _missing(system: str, name: str, why: str) -> SurveyedDevice:
    return SurveyedDevice(system, name, 0, 0, 0, microphones=why, actuator=why)
