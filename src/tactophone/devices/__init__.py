"""Sound devices that come and go: JACK clients, PortAudio streams, a clocked device, and a survey of them.

Microphones (`capture`) and actuators (`haptics`) share this room: opening with a clear error, silence when a server or
a device is lost, and reconnecting.
"""

from tactophone.devices.device import ClockedDevice, Device, Process, StreamDevice, open_at_rate
from tactophone.devices.dummy import DummyServer
from tactophone.devices.gamepad import GamepadDevice
from tactophone.devices.jack import JackClient, disconnect_from_jack
from tactophone.devices.portaudio import PortAudioStream
from tactophone.devices.survey import SurveyedDevice, survey

__all__ = [
    "ClockedDevice",
    "Device",
    "DummyServer",
    "GamepadDevice",
    "JackClient",
    "PortAudioStream",
    "Process",
    "StreamDevice",
    "SurveyedDevice",
    "disconnect_from_jack",
    "open_at_rate",
    "survey",
]
