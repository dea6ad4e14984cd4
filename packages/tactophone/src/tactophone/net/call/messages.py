"""What the two ends of a call tell each other, and how a mailbox or an end that lies is
noticed.

The messages pass through the mailbox, encrypted under the key that both derived from
the code. They are checked like anything else from outside: whoever knows the code may
still send nonsense.
"""

import ipaddress
from typing import Annotated, Literal, TypeAlias

import msgspec

from tactophone.core.errors import PacketError

Role: TypeAlias = Literal["robot", "operator"]

Nat: TypeAlias = Literal["blocked", "open", "keeps", "changes", "unknown"]
"""What lies between an end and the internet (`tactophone.net.call.check`)."""

_Word = Annotated[str, msgspec.Meta(pattern=r"\A[\w.+-]{1,64}\Z")]
_Line = Annotated[str, msgspec.Meta(pattern=r"\A[\x20-\x7e]{1,300}\Z")]
_Fingerprint = Annotated[
    str, msgspec.Meta(pattern=r"\A(?:[0-9A-F]{2}:){31}[0-9A-F]{2}\Z")
]
_IceWord = Annotated[str, msgspec.Meta(pattern=r"\A[a-zA-Z0-9+/]{4,256}\Z")]
_IcePassword = Annotated[str, msgspec.Meta(pattern=r"\A[a-zA-Z0-9+/]{22,256}\Z")]


class Hello(msgspec.Struct, tag=True, frozen=True, forbid_unknown_fields=True):
    """Who is there: what the answering person sees before accepting."""

    name: _Word
    role: Role | Literal[""]
    version: _Word
    fingerprint: _Fingerprint


class Accepted(msgspec.Struct, tag=True, frozen=True, forbid_unknown_fields=True):
    """The answering side accepts, and takes a role."""

    role: Role


class Address(msgspec.Struct, frozen=True, forbid_unknown_fields=True):
    """One address at which an end may be reached: a candidate of RFC 8445."""

    kind: Literal["host", "srflx", "relay"]
    host: Annotated[str, msgspec.Meta(max_length=64)]
    port: Annotated[int, msgspec.Meta(ge=1, le=65_535)]
    priority: Annotated[int, msgspec.Meta(ge=1, le=2**31 - 1)]
    foundation: Annotated[str, msgspec.Meta(pattern=r"\A[a-zA-Z0-9+/]{1,32}\Z")]

    def __post_init__(self) -> None:
        """Refuse a name, which would be looked up."""
        ipaddress.ip_address(self.host)


class Offer(msgspec.Struct, tag=True, frozen=True, forbid_unknown_fields=True):
    """Where this end may be reached, and how checks of the path are authenticated.

    - ``addresses``: for a direct path.
    - ``relayed``: for a path over a relay of either end.
    - ``relay``: whether this end has a relay.
    """

    user: _IceWord
    password: _IcePassword
    addresses: Annotated[list[Address], msgspec.Meta(max_length=64)]
    relayed: Annotated[list[Address], msgspec.Meta(max_length=64)]
    nat: Nat
    relay: bool


Progress: TypeAlias = Literal["starting", "opening", "ready"]
"""How far an end's live side is, in this order: it opens models and devices, then it
sends or renders."""


class State(msgspec.Struct, tag=True, frozen=True, forbid_unknown_fields=True):
    """How far this end is, told once there is a path; older ends read nothing from then
    on."""

    progress: Progress


class Refused(msgspec.Struct, tag=True, frozen=True, forbid_unknown_fields=True):
    """The call ends here."""

    reason: _Line


Message: TypeAlias = Hello | Accepted | Offer | State | Refused

LARGEST_MESSAGE = 20_000
"""Bytes of a message: what a mailbox passes on without complaint."""


def read_message(data: bytes) -> Message:
    """Decode a message of the other end.

    Raises `PacketError` if the bytes are something else.
    """
    try:
        if len(data) > LARGEST_MESSAGE:
            raise ValueError(f"{len(data)} bytes, but at most {LARGEST_MESSAGE}")
        message: Message = msgspec.json.decode(data, type=Message)
    except (ValueError, RecursionError) as error:
        raise PacketError(
            f"the other end sent something else than a call's message: {error}"
        ) from None
    return message


def write_message(message: Message) -> bytes:
    return msgspec.json.encode(message)
