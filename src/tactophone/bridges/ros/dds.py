"""DDS, ROS 2's usual way: Cyclone DDS joins the domain, without a ROS installation."""

import os
from typing import Any, Protocol

from cyclonedds.core import DDSException, Policy, Qos
from cyclonedds.domain import DomainParticipant
from cyclonedds.pub import DataWriter
from cyclonedds.sub import DataReader
from cyclonedds.topic import Topic
from cyclonedds.util import duration

from tactophone.errors import ConfigError

# ROS 2's default for topics: reliable, volatile, the newest ten.
QOS = Qos(
    Policy.Reliability.Reliable(duration(milliseconds=100)), Policy.Durability.Volatile, Policy.History.KeepLast(10)
)
LATCHED = Qos(
    Policy.Reliability.Reliable(duration(milliseconds=100)),
    Policy.Durability.TransientLocal,
    Policy.History.KeepLast(1),
)


class Transport(Protocol):
    """How messages of `tactophone.bridges.ros.messages` reach ROS 2; topics are without their first slash."""

    def writer(self, topic: str, kind: type, *, latched: bool = False) -> Any:
        """Return what has ``write(message)``; a ``latched`` message reaches late subscribers too."""

    def reader(self, topic: str, kind: type, *, latched: bool = False) -> Any:
        """Return what has ``take(N=...)``, a list of what came since the last call."""

    def close(self) -> None:
        """Leave."""


class DdsTransport:
    """A participant of a domain; raises `ConfigError` if it cannot be joined."""

    def __init__(self, domain: int) -> None:
        try:
            self._participant = DomainParticipant(domain)
        except DDSException as error:
            raise ConfigError(f"DDS cannot join domain {domain} ({error}): check CYCLONEDDS_URI") from error

    def writer(self, topic: str, kind: type, *, latched: bool = False) -> Any:
        """Return a writer."""
        return DataWriter(self._participant, self._topic(topic, kind, latched))

    def reader(self, topic: str, kind: type, *, latched: bool = False) -> Any:
        """Return a reader."""
        return DataReader(self._participant, self._topic(topic, kind, latched))

    def close(self) -> None:
        """Do nothing: a participant leaves when it is no longer referred to."""

    def _topic(self, topic: str, kind: type, latched: bool) -> Any:
        return Topic(self._participant, f"rt/{topic}", kind, LATCHED if latched else QOS)


def default_domain() -> int:
    """Return the domain of ROS_DOMAIN_ID."""
    text = os.environ.get("ROS_DOMAIN_ID", "0") or "0"
    if not text.isdecimal() or int(text) > 232:
        raise ConfigError(f"ROS_DOMAIN_ID is {text!r}, but it is a number from 0 to 232")
    return int(text)
