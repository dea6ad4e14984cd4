"""DTLS records as bytes (RFC 6347 section 4): only what is read before, or without, OpenSSL."""

from collections.abc import Iterator

from tactophone.link.srtp import MAX_DATAGRAM

_RECORD_HEADER = 13
_HELLO_RANDOM = slice(27, 59)
"""Position of a ClientHello's random, after the headers of record and message (RFC 6347 sections 4.1, 4.2)."""

_CHANGE_CIPHER, _ALERT, _HANDSHAKE, _CLIENT_HELLO, _FATAL = 20, 21, 22, 1, 2

_CERTIFICATE_ALERTS = range(42, 50)
"""Alerts on a certificate: bad, unsupported, revoked, expired, unknown, of an unknown authority, denied (RFC 5246)."""


def is_hello(datagram: bytes) -> bool:
    """Whether a datagram is a ClientHello, which begins a handshake."""
    return (
        len(datagram) >= _HELLO_RANDOM.stop
        and datagram[0] == _HANDSHAKE
        and datagram[13] == _CLIENT_HELLO
        and not is_encrypted(datagram)
    )


def hello_random(hello: bytes) -> bytes:
    """Return the caller's random, which is the same in a retransmitted ClientHello."""
    return hello[_HELLO_RANDOM]


def is_encrypted(datagram: bytes) -> bool:
    """Whether the first record is encrypted (its epoch is not 0)."""
    return datagram[3:5] != b"\0\0"


def is_plain_alert(datagram: bytes) -> bool:
    """Whether a datagram begins with an alert that is not encrypted, which anybody can forge."""
    return datagram[:1] == bytes([_ALERT]) and not is_encrypted(datagram)


def refuses_certificate(alert: bytes) -> bool:
    """Whether a plain alert says that the certificate was not accepted."""
    return len(alert) >= _RECORD_HEADER + 2 and alert[13] == _FATAL and alert[14] in _CERTIFICATE_ALERTS


class NewRecords:
    """Removes from OpenSSL's output the messages that it has written before.

    OpenSSL has a retransmission timer that reads the wall clock and cannot be turned off from here. When a datagram
    comes more than a second after the newest flight, it writes that flight again, *before* the next one: an answerer
    takes the two together for a new call, and a caller that is done for a flight that was lost.
    """

    def __init__(self) -> None:
        self._messages, self._changed_cipher = 0, False

    def of(self, written: bytes) -> bytes:
        """Return the records that are new."""
        records = list(_records(written))
        fresh = b"".join(record for record in records if self._is_new(record))
        numbers = [_message_number(record) for record in records if _is_plain_message(record)]
        self._messages = max([self._messages, *(number + 1 for number in numbers)])
        self._changed_cipher |= any(record[0] == _CHANGE_CIPHER for record in records)
        return fresh

    def _is_new(self, record: bytes) -> bool:
        if _is_plain_message(record):
            return _message_number(record) >= self._messages
        # Only one flight of each end holds these: the cipher's change, and the encrypted message after it.
        return record[0] not in (_CHANGE_CIPHER, _HANDSHAKE) or not self._changed_cipher

    @property
    def changed_cipher(self) -> bool:
        """Whether this end has sent its last message, under the new keys."""
        return self._changed_cipher


def changes_cipher(datagram: bytes) -> bool:
    """Whether a datagram begins with the last flight of an answerer."""
    return datagram[:1] == bytes([_CHANGE_CIPHER])


def split_flight(written: bytes) -> Iterator[bytes]:
    """Return OpenSSL's output as datagrams of whole records; its memory buffer has no datagram boundaries."""
    datagram = b""
    for record in _records(written):
        if datagram and len(datagram) + len(record) > MAX_DATAGRAM:
            yield datagram
            datagram = b""
        datagram += record
    if datagram:
        yield datagram


def _is_plain_message(record: bytes) -> bool:
    return record[0] == _HANDSHAKE and not is_encrypted(record)


def _message_number(record: bytes) -> int:
    """Return the number of the handshake message in a record (RFC 6347 section 4.2.2)."""
    return int.from_bytes(record[17:19])


def _records(written: bytes) -> Iterator[bytes]:
    position = 0
    while position < len(written):
        end = position + _RECORD_HEADER + int.from_bytes(written[position + 11 : position + 13])
        yield written[position:end]
        position = end
