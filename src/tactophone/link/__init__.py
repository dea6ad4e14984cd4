"""Sound over the network: codec, packets, sealed sessions, arrival, playout and statistics.

Everything here is values, with the time as an argument; only :mod:`~tactophone.link.udp` touches a socket.
"""

from tactophone.link.arrival import Arrival, Heard
from tactophone.link.codec import Codec
from tactophone.link.departure import Departure, Redundancy, RedundancyRule
from tactophone.link.identity import Identity, Peers
from tactophone.link.playout import Playout
from tactophone.link.receiving import Believed, News, ReceivingEnd
from tactophone.link.roundtrip import round_trip
from tactophone.link.sending import SendingEnd
from tactophone.link.session import Arrived, Connected, Disconnected, Event, Session
from tactophone.link.stats import StreamStats
from tactophone.link.udp import DatagramSocket, Endpoint, UdpSocket, resolve

__all__ = [
    "Arrival",
    "Arrived",
    "Believed",
    "Codec",
    "Connected",
    "DatagramSocket",
    "Departure",
    "Disconnected",
    "Endpoint",
    "Event",
    "Heard",
    "Identity",
    "News",
    "Peers",
    "Playout",
    "ReceivingEnd",
    "Redundancy",
    "RedundancyRule",
    "SendingEnd",
    "Session",
    "StreamStats",
    "UdpSocket",
    "resolve",
    "round_trip",
]
