"""Sound devices that come and go: JACK clients, PortAudio streams, a clocked device, and a survey of them.

Microphones (`capture`) and actuators (`haptics`) share this room: opening with a clear error, silence when a server or
a device is lost, and reconnecting.
"""

from tactophone.devices.clocked import ClockedDevice
from tactophone.devices.device import Device, Process, open_at_rate
from tactophone.devices.dummy import DummyServer
from tactophone.devices.gamepad import GamepadDevice
from tactophone.devices.jack import JackClient
from tactophone.devices.jack_sockets import disconnect_from_jack
from tactophone.devices.portaudio import PortAudioStream
from tactophone.devices.stream import StreamDevice
from tactophone.devices.survey import SurveyedDevice, survey
from tactophone.devices.sweep import MeasuredResponse, SweepRecorder, fit, sweep

__all__ = [
    "ClockedDevice",
    "Device",
    "DummyServer",
    "GamepadDevice",
    "JackClient",
    "MeasuredResponse",
    "PortAudioStream",
    "Process",
    "StreamDevice",
    "SurveyedDevice",
    "SweepRecorder",
    "disconnect_from_jack",
    "fit",
    "open_at_rate",
    "survey",
    "sweep",
]
