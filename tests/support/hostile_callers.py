"""Callers that mean harm, as values: for the tests of sessions and for fuzzing.

They repeat what once ended the operator's process. Nothing here opens a socket.
"""

import datetime
import heapq
import itertools
from collections.abc import Callable

from cryptography import x509
from cryptography.hazmat.primitives import hashes, serialization
from cryptography.hazmat.primitives.asymmetric import ec
from cryptography.x509.oid import NameOID
from OpenSSL import SSL, crypto

from tactophone.net.link.handshake import PROFILE
from tactophone.net.link.identity import Identity, Peers
from tactophone.net.link.packet import Address
from tactophone.net.link.session import Session

Answer = Callable[[bytes], list[bytes]]
"""Sends a datagram to the answerer; returns its replies."""

POLL_INTERVAL = 0.02
"""Seconds between two polls of a caller."""

CERTIFICATE_FAULTS = ("version", "month")


def odd_certificate(fault: str) -> tuple[ec.EllipticCurvePrivateKey, bytes]:
    """Return a key and a certificate (DER) that OpenSSL parses and the library
    ``cryptography`` refuses."""
    key = ec.generate_private_key(ec.SECP256R1())
    name = x509.Name([x509.NameAttribute(NameOID.COMMON_NAME, "odd")])
    begin = datetime.datetime(2026, 1, 1, tzinfo=datetime.UTC)
    builder = x509.CertificateBuilder(
        name, name, key.public_key(), 4, begin, begin + datetime.timedelta(days=9_000)
    )
    der = bytearray(
        builder.sign(key, hashes.SHA256()).public_bytes(serialization.Encoding.DER)
    )
    if fault == "version":
        der[der.index(b"\xa0\x03\x02\x01\x02") + 4] = 7  # X.509 version 8
    else:
        at = der.index(b"\x17\x0d") + 2  # the first UTCTime, YYMMDD...: 13th month
        der[at : at + 4] = b"9913"
    return key, bytes(der)


def call_with_certificate(fault: str, answer: Answer) -> None:
    """Run a whole handshake as a caller with an odd certificate."""
    key, der = odd_certificate(fault)
    context = SSL.Context(SSL.DTLS_METHOD)
    context.use_certificate(crypto.load_certificate(crypto.FILETYPE_ASN1, der))
    context.use_privatekey(key)
    context.set_tlsext_use_srtp(PROFILE)
    context.set_verify(SSL.VERIFY_NONE, lambda *_: True)
    connection = SSL.Connection(context, None)
    connection.set_ciphertext_mtu(1_200)
    connection.set_connect_state()
    for _ in range(6):
        try:
            connection.do_handshake()
        except SSL.WantReadError:
            pass
        except SSL.Error:
            return
        try:
            for reply in answer(connection.bio_read(1 << 16)):
                connection.bio_write(reply)
        except SSL.WantReadError:
            return


def overlong_hello(answer: Answer, high: int) -> bytes:
    """Return a ClientHello with the cookie that ``answer`` gave, whose message is
    longer than its record says."""
    caller = Session(Identity.create("eve"), Peers({"AB" * 32: "op"}), call=("h", 1))
    caller.poll(0.0)
    ((hello, _),) = caller.outgoing()
    (verify,) = answer(hello)
    # It lies after the headers of record and message and the version, with its length.
    cookie = verify[27:][: verify[27] + 1]
    body = hello[25:]
    place = 35 + body[34]  # after version, random and session identifier
    body = body[:place] + cookie + body[place + 1 + body[place] :]
    length = len(body).to_bytes(3, "big")
    message = (
        bytes([1, high])
        + length[1:]
        + (1).to_bytes(2, "big")
        + bytes(3)
        + length
        + body
    )
    return (
        hello[:3]
        + bytes(2)
        + (1).to_bytes(6, "big")
        + len(message).to_bytes(2, "big")
        + message
    )


class DelayedLine:
    """Joins an answerer with any number of callers, with the same delay each way, in
    virtual time."""

    def __init__(self, answerer: Session, *, address: Address, delay: float) -> None:
        self.answerer = answerer
        self.address = address
        self.delay = delay
        self.callers: dict[Address, Session] = {}
        self.now = 0.0
        self._next_poll: dict[Address, float] = {}
        self._queue: list[tuple[float, int, Address, bool, bytes]] = []
        self._numbers = itertools.count()

    def step(self, duration: float) -> None:
        """Let time pass, and carry what is due."""
        self.now += duration
        self.answerer.poll(self.now)
        for address, caller in self.callers.items():
            if self.now >= self._next_poll.get(address, 0.0):
                self._next_poll[address] = self.now + POLL_INTERVAL
                caller.poll(self.now)
                self._collect(address, caller)
        while self._queue and self._queue[0][0] <= self.now:
            _, _, address, to_answerer, datagram = heapq.heappop(self._queue)
            if to_answerer:
                self.answerer.receive(datagram, source=address, now=self.now)
                self._reply()
            elif address in self.callers:
                self.callers[address].receive(
                    datagram, source=self.address, now=self.now
                )
                self._collect(address, self.callers[address])
        self._reply()

    def _collect(self, address: Address, caller: Session) -> None:
        for datagram, _ in caller.outgoing():
            self._put(address, True, datagram)

    def _reply(self) -> None:
        for datagram, address in self.answerer.outgoing():
            self._put(address, False, datagram)

    def _put(self, address: Address, to_answerer: bool, datagram: bytes) -> None:
        heapq.heappush(
            self._queue,
            (
                self.now + self.delay,
                next(self._numbers),
                address,
                to_answerer,
                datagram,
            ),
        )
