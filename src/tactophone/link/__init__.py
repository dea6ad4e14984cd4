"""Sound over the network: codec, packets, encrypted sessions, playout and statistics.

All modules compute on values, with the time as an argument; only :mod:`~tactophone.link.udp` uses a socket.
"""

from tactophone.link.codec import NARROW_BAND, Codec, encode_and_decode, open_decoder, open_encoder
from tactophone.link.events import Connected, Disconnected, Event, LoggedSession, PacketReceived, Renewed, write_event
from tactophone.link.identity import CERTIFICATE_FILE, IDENTITY_FOLDER, KEY_FILE, Identity, Peers
from tactophone.link.packet import Address, parse_packet
from tactophone.link.playout import Playout, PlayoutController
from tactophone.link.receive import PredictionReceived, ReceiveEvent, ReceiveSession
from tactophone.link.send import MOST_OPERATORS, Datagrams, SendGroup
from tactophone.link.session import Session
from tactophone.link.stream import BlockEncoder, DecodedAudio, Depacketizer, Packetizer, Redundancy, RedundancyRule
from tactophone.link.udp import UdpSocket, resolve

__all__ = [
    "CERTIFICATE_FILE",
    "IDENTITY_FOLDER",
    "KEY_FILE",
    "MOST_OPERATORS",
    "NARROW_BAND",
    "Address",
    "BlockEncoder",
    "Codec",
    "Connected",
    "Datagrams",
    "DecodedAudio",
    "Depacketizer",
    "Disconnected",
    "Event",
    "Identity",
    "LoggedSession",
    "PacketReceived",
    "Packetizer",
    "Peers",
    "Playout",
    "PlayoutController",
    "PredictionReceived",
    "ReceiveEvent",
    "ReceiveSession",
    "Redundancy",
    "RedundancyRule",
    "Renewed",
    "SendGroup",
    "Session",
    "UdpSocket",
    "encode_and_decode",
    "open_decoder",
    "open_encoder",
    "parse_packet",
    "resolve",
    "write_event",
]
