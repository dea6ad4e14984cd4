"""Zenoh, the other way of ROS 2 (`rmw_zenoh_cpp`): the same messages under its key
expressions.

A topic is the key ``<domain>/<topic>/<type>/<RIHS01 hash of the type>``, a message is
CDR with an attachment of number, time and identity of its writer, and a liveliness
token says that the writer is there: github.com/ros2/rmw_zenoh, docs/design.md and the
layouts that its sources give. Needs the extra ``zenoh``.
"""

import itertools
import json
import os
import struct
import time
import uuid
from typing import Any

import zenoh
from zenoh import ext

from tactophone.core.errors import ConfigError
from tactophone.faces.bridges.ros_topics import (
    LARGEST_SAMPLE,
    open_type_store,
    type_name,
)

ROUTER = "tcp/localhost:7447"
"""Where `ros2 run rmw_zenoh_cpp rmw_zenohd` listens."""

# Quality of service as rmw_zenoh writes it into a liveliness token: fields that differ
# from the defaults, here the durability and the depth of the history.
_VOLATILE = "::,10:,:,:,,"
_TRANSIENT_LOCAL = ":1:,1:,:,:,,"

_ATTACHMENT = struct.Struct("<qqB16s")
"""What rmw_zenoh attaches to a message: its number, the time in ns, and the size and
bytes of the writer's identity."""


class ZenohTransport:
    """A session of Zenoh, as ZENOH_SESSION_CONFIG_URI configures it, or else at the
    router of this machine.

    Raises `ConfigError` if the session cannot be opened.
    """

    def __init__(self, domain: int) -> None:
        self._domain = domain
        self._types = open_type_store()
        self._numbers = itertools.count(1)
        try:
            self._session: Any = zenoh.open(_config())
        except zenoh.ZError as error:
            raise ConfigError(
                f"Zenoh cannot open a session ({error}): check ZENOH_SESSION_CONFIG_URI"
            ) from error
        # A token lives as long as it is kept.
        self._tokens = [self._token("NN", 0)]

    def writer(self, topic: str, kind: type, *, latched: bool = False) -> Any:
        key = f"{self._domain}/{topic}/{_wire_name(kind)}/{self._hash(kind)}"
        cache = ext.CacheConfig(max_samples=1) if latched else None
        publisher = ext.declare_advanced_publisher(
            self._session, key, cache=cache, publisher_detection=latched
        )
        place = f"%{topic.replace('/', '%')}/{_wire_name(kind)}/{self._hash(kind)}"
        self._tokens.append(
            self._token(
                "MP",
                next(self._numbers),
                f"/{place}/{_TRANSIENT_LOCAL if latched else _VOLATILE}",
            )
        )
        return _Writer(publisher)

    def reader(
        self,
        topic: str,
        kind: type,
        *,
        latched: bool = False,
        best_effort: bool = False,
    ) -> Any:
        """Return a subscriber; the type's hash may come from any version of
        ROS."""
        del latched
        return _Reader(
            kind,
            self._session.declare_subscriber(
                f"{self._domain}/{topic}/{_wire_name(kind)}/*"
            ),
        )

    def close(self) -> None:
        self._session.close()

    def _token(self, entity: str, number: int, ending: str = "") -> Any:
        # Session, node and entity; then enclave and name space, which are empty, and
        # the name of the node.
        place = f"{self._session.zid()}/0/{number}/{entity}/%/%/tactophone"
        return self._session.liveliness().declare_token(
            f"@ros2_lv/{self._domain}/{place}{ending}"
        )

    def _hash(self, kind: type) -> str:
        return str(self._types.hash_rihs01(type_name(kind)))


class _Writer:
    def __init__(self, publisher: Any) -> None:
        self._publisher = publisher
        self._identity = uuid.uuid4().bytes
        self._count = 0

    def write(self, message: Any) -> None:
        self._count += 1
        attachment = _ATTACHMENT.pack(
            self._count, time.time_ns(), len(self._identity), self._identity
        )
        self._publisher.put(message.serialize(), attachment=attachment)


class _Reader:
    def __init__(self, kind: Any, subscriber: Any) -> None:
        self._kind = kind
        self._subscriber = subscriber

    def take(self, N: int = 1) -> list[Any]:
        samples = (self._subscriber.try_recv() for _ in range(N))
        return [
            self._read(sample)
            for sample in itertools.takewhile(
                lambda sample: sample is not None, samples
            )
        ]

    def _read(self, sample: Any) -> Any:
        """Return the message, or a sample that holds none as it is: whatever comes to
        the topic of a stop is one."""
        if len(sample.payload) > LARGEST_SAMPLE:
            return sample
        try:
            return self._kind.deserialize(bytes(sample.payload))
        except Exception:
            return sample


def _wire_name(kind: type) -> str:
    return str(kind.__idl_typename__).replace(".", "::")  # type: ignore[attr-defined]


def _config() -> Any:
    """Return the session's configuration: by default as `rmw_zenoh_cpp` has it, a peer
    that asks the router alone."""
    path = os.environ.get("ZENOH_SESSION_CONFIG_URI")
    config = zenoh.Config.from_file(path) if path else zenoh.Config()
    own = {
        "mode": "peer",
        "connect/endpoints": [ROUTER],
        "listen/endpoints": ["tcp/localhost:0"],
        "scouting/multicast/enabled": False,
    }
    # Latched messages are kept by their time.
    for name, value in {**({} if path else own), "timestamping/enabled": True}.items():
        config.insert_json5(name, json.dumps(value))
    return config
