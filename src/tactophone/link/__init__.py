"""Sound over the network: codec, packets, sealed sessions, arrival, playout and statistics.

Everything here is values, with the time as an argument; only :mod:`~tactophone.link.udp` touches a socket.
"""

from tactophone.link.codec import Codec
from tactophone.link.codec_loopback import round_trip
from tactophone.link.depacketizer import DecodedAudio, Depacketizer
from tactophone.link.identity import Identity, Peers
from tactophone.link.packetizer import Packetizer, Redundancy, RedundancyRule
from tactophone.link.playout import Playout
from tactophone.link.receive_session import PredictionReceived, ReceiveEvent, ReceiveSession
from tactophone.link.send_session import SendSession
from tactophone.link.session import Connected, Disconnected, Event, PacketReceived, Session
from tactophone.link.stats import StreamStats
from tactophone.link.udp import DatagramSocket, Endpoint, UdpSocket, resolve

__all__ = [
    "Codec",
    "Connected",
    "DatagramSocket",
    "DecodedAudio",
    "Depacketizer",
    "Disconnected",
    "Endpoint",
    "Event",
    "Identity",
    "PacketReceived",
    "Packetizer",
    "Peers",
    "Playout",
    "PredictionReceived",
    "ReceiveEvent",
    "ReceiveSession",
    "Redundancy",
    "RedundancyRule",
    "SendSession",
    "Session",
    "StreamStats",
    "UdpSocket",
    "resolve",
    "round_trip",
]
