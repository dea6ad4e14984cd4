"""What sound devices there are, and which are fit for two microphones or for an actuator, and why not."""

from collections.abc import Iterator
from dataclasses import dataclass

from tactophone.devices.jack import JackClient, silent
from tactophone.devices.portaudio import PortAudioDevice, devices
from tactophone.errors import DeviceError

WANTED_RATE = 48_000
"""Hz of the whole journey."""

TOO_SLOW = 0.02
"""Seconds of a device's own delay from which it is called slow: a third of what is noticed in texture."""


@dataclass(frozen=True, slots=True)
class Found:
    """One device, or one system that is not there.

    Parameters
    ----------
    settings
        What to write to use it, as for ``--set``.
    microphones, actuator
        Why it is not fit; empty when it is.
    note
        What else one should know.
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


def survey(*, jack_server: str = "") -> list[Found]:
    """Look at the JACK server and at all that PortAudio sees."""
    return [_jack(jack_server), *_portaudio()]


def _jack(server: str) -> Found:
    client = JackClient("tactophone-survey", silent, inputs={}, outputs={}, server=server)
    try:
        client.open()
    except DeviceError as error:
        return _missing("JACK", server or "default server", str(error))
    ports = [port for port in client.ports() if port.physical]
    rate, period = client.sample_rate, client.period
    client.close()
    gives, takes = [port.name for port in ports if port.gives], [port.name for port in ports if not port.gives]
    wiring = [f"capture.{name}={port}" for name, port in zip(("contact", "air"), gives, strict=False)]
    return Found(
        "JACK",
        server or "default server",
        len(gives),
        len(takes),
        rate,
        microphones=_why_not_microphones(len(gives), rate),
        actuator=_why_not_actuator(len(takes), rate),
        settings=(
            "capture.source=jack",
            *wiring,
            "output.actuator=jack",
            *(f"output.port={port}" for port in takes[:1]),
        ),
        note=f"periods of {period} samples, {1000 * period / rate:.1f} ms",
    )


def _portaudio() -> Iterator[Found]:
    try:
        found = devices()
    except DeviceError as error:
        yield _missing("PortAudio", "", str(error))
        return
    if not found:
        yield _missing("PortAudio", "", "no devices: plug a sound card in")
    yield from map(_judge, found)


def _judge(device: PortAudioDevice) -> Found:
    rate = round(device.sample_rate)
    latency = max(device.input_latency * bool(device.inputs), device.output_latency * bool(device.outputs))
    slow = f"slow: adds {1000 * latency:.0f} ms" if latency > TOO_SLOW else f"adds {1000 * latency:.1f} ms"
    return Found(
        f"PortAudio, {device.system}",
        device.name,
        device.inputs,
        device.outputs,
        rate,
        microphones=_why_not_microphones(device.inputs, WANTED_RATE),
        actuator=_why_not_actuator(device.outputs, WANTED_RATE),
        settings=(f"capture.device={device.index}", f"output.device={device.index}"),
        note="use source jack instead" if device.system.startswith("JACK") else slow,
    )


def _why_not_microphones(inputs: int, rate: int) -> str:
    if rate != WANTED_RATE:
        return f"runs at {rate} Hz, wants {WANTED_RATE}"
    if inputs == 1:
        return "one input: only with a one-channel model (capture.air empty)"
    return "" if inputs else "no inputs"


def _why_not_actuator(outputs: int, rate: int) -> str:
    if rate != WANTED_RATE:
        return f"runs at {rate} Hz, wants {WANTED_RATE}"
    return "" if outputs else "no outputs"


def _missing(system: str, name: str, why: str) -> Found:
    return Found(system, name, 0, 0, 0, microphones=why, actuator=why)
