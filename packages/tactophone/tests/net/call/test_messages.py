"""What the two ends of a call tell each other."""

import pytest

from tactophone.core.errors import PacketError
from tactophone.net.call.messages import (
    Accepted,
    Address,
    Hello,
    Offer,
    Refused,
    State,
    read_message,
    write_message,
)

OFFER = Offer(
    "user",
    "p" * 22,
    [Address("host", "192.0.2.7", 4000, 5, "f1")],
    [Address("relay", "192.0.2.9", 4001, 5, "f2")],
    "keeps",
    relay=True,
)
HELLO = Hello("lab-7", "robot", "0.1.0", ":".join(["0A"] * 32))
MESSAGES = [HELLO, Accepted("operator"), OFFER, State("opening"), Refused("no")]


@pytest.mark.parametrize("message", MESSAGES, ids=lambda each: type(each).__name__)
def test_a_message_arrives_as_it_was_sent(
    message: Hello | Accepted | Offer | State | Refused,
) -> None:
    assert read_message(write_message(message)) == message


@pytest.mark.parametrize(
    ("before", "after"),
    [
        (b"192.0.2.7", b"mailbox.example"),  # a name would be looked up
        (b'"port":4000', b'"port":0'),
        (b'"host",', b'"prflx",'),
        (b'"keeps"', b'"perhaps"'),
        (b'"lab-7"', b'"lab\\u001b[2J"'),  # a terminal would obey it
        (b'"no"', b'"\\nno"'),
        (b'"0A:', b'"0a:'),
        (b'"robot"', b'"pilot"'),
        (b'"opening"', b'"opened"'),
        (b'"user"', b'"u"'),
        (b'{"type"', b'{"more":1,"type"'),
        (b'{"kind"', b'{"more":1,"kind"'),
        (b"{", b""),
    ],
)
def test_anything_else_is_refused(before: bytes, after: bytes) -> None:
    changed = [
        write_message(each).replace(before, after)
        for each in MESSAGES
        if before in write_message(each)
    ]
    assert changed
    for data in changed:
        with pytest.raises(PacketError, match="something else than a call's message"):
            read_message(data)


def test_a_message_of_any_size_is_refused_before_it_is_parsed() -> None:
    with pytest.raises(PacketError, match="at most 20000"):
        read_message(b"[" * 1_000_000)
