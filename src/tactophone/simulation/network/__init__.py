"""Impaired networks, in virtual time and between real sockets."""

from tactophone.simulation.network.impairments import PROFILES, ImpairedLink, NetworkProfile, network_profile
from tactophone.simulation.network.proxy import ImpairmentProxy
from tactophone.simulation.network.virtual_link import VirtualLink, paired_sessions

__all__ = [
    "PROFILES",
    "ImpairedLink",
    "ImpairmentProxy",
    "NetworkProfile",
    "VirtualLink",
    "network_profile",
    "paired_sessions",
]
