"""Sound over the network: codec, packets, encrypted sessions, playout and statistics.

All modules compute on values, with the time as an argument; only :mod:`~tactophone.link.udp` uses a socket.
"""

from tactophone.link.block_encoder import BlockEncoder
from tactophone.link.codec import NARROW_BAND, Codec, encode_and_decode, open_decoder, open_encoder
from tactophone.link.depacketizer import DecodedAudio, Depacketizer
from tactophone.link.events import Connected, Disconnected, Event, PacketReceived, Renewed
from tactophone.link.handshake import Address
from tactophone.link.identity import CERTIFICATE_FILE, IDENTITY_FOLDER, KEY_FILE, Identity, Peers
from tactophone.link.packet import parse_packet
from tactophone.link.packetizer import Packetizer, Redundancy, RedundancyRule
from tactophone.link.playout import Playout
from tactophone.link.playout_clock import PlayoutController
from tactophone.link.receive_session import PredictionReceived, ReceiveEvent, ReceiveSession
from tactophone.link.send import MOST_OPERATORS, Datagrams, SendGroup
from tactophone.link.session import Session
from tactophone.link.session_log import LoggedSession, write_event
from tactophone.link.udp import DatagramSocket, Endpoint, UdpSocket, resolve, resolve_all

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
    "DatagramSocket",
    "Datagrams",
    "DecodedAudio",
    "Depacketizer",
    "Disconnected",
    "Endpoint",
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
    "resolve_all",
    "write_event",
]
