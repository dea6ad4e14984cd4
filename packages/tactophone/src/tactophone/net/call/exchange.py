"""The mailbox: two ends that know one code exchange messages under a key that nobody
else learns.

magic-wormhole derives the key with SPAKE2: whoever guesses at a code has one guess, and
both ends notice a wrong one. Its reactor runs in the process's asyncio loop, and once a
process.
"""

import asyncio
import contextlib
import hashlib
import hmac
import json
from collections.abc import Iterator
from typing import Any

import wormhole
from twisted.internet import asyncioreactor
from wormhole.errors import KeyFormatError, LonelyError, ServerError, WrongPasswordError

from tactophone.core.errors import DeviceError, TactophoneError, plain
from tactophone.net.call.messages import Message, read_message, write_message

APPLICATION = "tactophone.org/call/2"
"""Separates our codes from other programs' in a mailbox that serves many; no address
that anybody asks."""

WELCOME_TIMEOUT = 20.0
"""Seconds to wait for the mailbox's first word, and for the number of a new code."""

MEET_TIMEOUT = 15.0
"""Seconds until the end that was told a code gives up: the other end waits at it
already, so that one answer of the network is enough."""

GONE_TIMEOUT = 10.0
"""Seconds for which a mailbox may be away; the library tries to reach it again, after 1
s at first."""

PING_INTERVAL = 5
"""Seconds between two questions whether the mailbox is still there: one that lost its
network says no word of it."""

PING_TIMEOUT = 10
"""Seconds until such a question counts as unanswered. With the time before it and
`GONE_TIMEOUT`, a caller hears of a mailbox's end within 27 s."""

LARGEST_WORD = 1 << 17
"""Bytes of a message of the mailbox: ours are at most 20,000, in hexadecimal and
JSON."""

MOST_WORDS = 4_000_000
"""Bytes of all messages of one exchange, from the mailbox and from the other end: the
library keeps each of them, also while a person is asked whether to accept."""

COST_OF_A_WORD = 1_000
"""Bytes that a message counts at least: what the library keeps beside its text."""

LONGEST_CODE = 100
"""Most characters of a code; a longer one is refused. The codes derived from a
secret are the longest, with 78 at most."""

SECRET_SIZE = 32
"""Bytes of the secret from which two ends derive the code of their next call."""


def install(loop: asyncio.AbstractEventLoop) -> None:
    """Let Twisted run in this loop; once a process, before anything else of Twisted is
    imported."""
    asyncioreactor.install(loop)
    from twisted.internet import reactor
    from twisted.logger import globalLogBeginner
    from wormhole import _rendezvous

    class Factory(_rendezvous.WSFactory):  # type: ignore[misc]  # the library has no word for a bound; it is pinned
        protocol = bounded_client()
        heard = 0

        def setProtocolOptions(self, **chosen: Any) -> None:  # noqa: N802
            bounds = dict.fromkeys(
                ("maxMessagePayloadSize", "maxFramePayloadSize"), LARGEST_WORD
            )
            pings = {
                "autoPingInterval": PING_INTERVAL,
                "autoPingTimeout": PING_TIMEOUT,
            }
            super().setProtocolOptions(**chosen | bounds | pings)

    _rendezvous.WSFactory = Factory

    # A mailbox's nonsense would be a traceback on the terminal; what it means for a
    # call is raised.
    globalLogBeginner.beginLoggingTo([], discardBuffer=True, redirectStandardIO=False)
    reactor.startRunning(installSignalHandlers=False)


def bounded_client() -> Any:
    """Return the library's end of a mailbox, which then prints nothing, ends a call at
    once that was refused, and passes on `MOST_WORDS` at most."""
    from wormhole._rendezvous import WSClient

    class Client(WSClient):  # type: ignore[misc]
        def onMessage(self, payload: bytes, isBinary: bool) -> None:  # noqa: N802
            # The factory counts, as it outlives a connection.
            before = self.factory.heard
            if before > MOST_WORDS:
                return
            self.factory.heard = before + len(payload) + COST_OF_A_WORD
            try:
                if self.factory.heard > MOST_WORDS:
                    raise ServerError("it says more than a call needs")
                if (said := json.loads(payload))["type"] == "error":
                    # Otherwise the library would ask the mailbox to close, and wait.
                    raise ServerError(str(said["error"]))
                self._RC.ws_message(payload)
            except Exception as error:
                # Whatever a mailbox's words make the library raise.
                self._RC._B.error(error)

    return Client


def uninstall() -> None:
    """End Twisted's threads, which would keep the process alive."""
    from twisted.internet import reactor

    reactor.fireSystemEvent("shutdown")


def code_of(secret: bytes) -> str:
    """Return the code that two ends derive from the secret of their last call."""
    number = hmac.digest(secret, b"tactophone call number", hashlib.sha256)[:5]
    words = hmac.digest(secret, b"tactophone call words", hashlib.sha256)
    return f"{1_000_000 + int.from_bytes(number)}-{words.hex()}"


class Exchange:
    """One exchange through the mailbox at a URL; a context manager of asyncio."""

    def __init__(self, mailbox: str) -> None:
        from twisted.internet import reactor

        self._mailbox = mailbox
        self._loop = asyncio.get_running_loop()
        self._gone: asyncio.Future[None] = self._loop.create_future()
        self._going: asyncio.TimerHandle | None = None
        self._was_connected = False
        with self._explained():
            self._wormhole: Any = wormhole.create(
                APPLICATION, mailbox, reactor, on_status_update=self._note_status
            )

    async def __aenter__(self) -> "Exchange":
        return self

    async def __aexit__(self, *_: object) -> None:
        self._stop_waiting_for_mailbox()
        # It frees the number of the code; errors of the exchange were raised before.
        with contextlib.suppress(Exception):
            async with asyncio.timeout(1.0):
                await self._wormhole.close().asFuture(self._loop)

    async def open(self, code: str = "") -> str:
        """Reserve a new code, or use one; return it."""
        with self._explained():
            async with asyncio.timeout(WELCOME_TIMEOUT):
                await self._wait(self._wormhole.get_welcome())
                if code:
                    self._wormhole.set_code(code)
                else:
                    self._wormhole.allocate_code(2)
                found = plain(str(await self._wait(self._wormhole.get_code())))
        if len(found) > LONGEST_CODE:
            # Cut short, it would lack the words that it needs.
            raise DeviceError(
                f"a code of {len(found)} characters, but at most {LONGEST_CODE} are "
                "taken: check it, or name another mailbox with --set call.mailbox=..."
            )
        return found

    async def meet(self, *, timeout: float | None = None) -> bytes:
        """Wait until the other end uses the same code; return a secret that both now
        share.

        ``timeout`` is for an end that was told the code, at which the other one waits.
        """
        with self._explained():
            try:
                async with asyncio.timeout(timeout):
                    await self._wait(self._wormhole.get_verifier())
            except TimeoutError:
                raise DeviceError(
                    "nobody waits at this code: it is mistyped, used up, or the other "
                    "end has hung up; run `tactophone call` there for a new one"
                ) from None
            return bytes(
                self._wormhole.derive_key("tactophone call secret", SECRET_SIZE)
            )

    async def receive(self) -> Message:
        with self._explained():
            return read_message(bytes(await self._wait(self._wormhole.get_message())))

    def send(self, message: Message) -> None:
        self._wormhole.send_message(write_message(message))

    async def _wait(self, deferred: Any) -> Any:
        """Wait for a word of the mailbox, as long as there is one."""
        word = deferred.asFuture(self._loop)
        try:
            await asyncio.wait({word, self._gone}, return_when=asyncio.FIRST_COMPLETED)
            if word.done():
                return word.result()
            raise DeviceError(
                f"the mailbox {self._mailbox} is gone: check the network, and call "
                "again, or name another with --set call.mailbox=..."
            )
        finally:
            word.cancel()

    def _note_status(self, status: Any) -> None:
        """Heed the library's word for whether there is a connection to the mailbox."""
        if type(status.mailbox_connection).__name__ == "Connected":
            self._was_connected = True
            self._stop_waiting_for_mailbox()
        elif self._was_connected and self._going is None:
            # The library says so at each attempt to reach it again.
            self._going = self._loop.call_later(GONE_TIMEOUT, self._give_up)

    def _stop_waiting_for_mailbox(self) -> None:
        if self._going:
            self._going.cancel()
        self._going = None

    def _give_up(self) -> None:
        if not self._gone.done():
            self._gone.set_result(None)

    @contextlib.contextmanager
    def _explained(self) -> Iterator[None]:
        try:
            yield
        except WrongPasswordError:
            raise DeviceError(
                "the code is wrong, or somebody else tried it; it is used up: run "
                "`tactophone call` for a new one"
            ) from None
        except KeyFormatError:
            raise DeviceError(
                "a code is a number and two words, such as 3-escapade-peachy: check it"
            ) from None
        except TimeoutError:
            raise DeviceError(
                f"the mailbox {self._mailbox} has said nothing for "
                f"{WELCOME_TIMEOUT:g} s; check the network, or name "
                "another with --set call.mailbox=..."
            ) from None
        except LonelyError:
            raise DeviceError(
                "nobody else used this code: check it, and whether the other end "
                "still waits"
            ) from None
        except TactophoneError:
            raise
        except Exception as error:
            # What the mailbox says reaches the state machines of a library, which raise
            # exceptions of any kind.
            raise DeviceError(
                f"the mailbox {self._mailbox} does not serve this call "
                f"({_words(error)}); check the network, or name "
                "another with --set call.mailbox=..."
            ) from None


def _words(error: Exception) -> str:
    reason = getattr(error, "reason", None) or getattr(error, "args", ("",))
    return (
        plain(str(reason[0] if isinstance(reason, tuple) and reason else reason))[:160]
        or type(error).__name__
    )
