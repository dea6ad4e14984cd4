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

APPLICATION = "tactophone.org/call/1"
"""Separates our codes from other programs' in a mailbox that serves many; no address
that anybody asks."""

WELCOME_TIMEOUT = 20.0
"""Seconds to wait for the mailbox's first word, and for the number of a new code."""

LARGEST_WORD = 1 << 17
"""Bytes of a message of the mailbox: ours are at most 20,000, in hexadecimal and
JSON."""

LONGEST_CODE = 100

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

        def setProtocolOptions(self, **chosen: Any) -> None:  # noqa: N802
            bounds = dict.fromkeys(
                ("maxMessagePayloadSize", "maxFramePayloadSize"), LARGEST_WORD
            )
            super().setProtocolOptions(**chosen | bounds)

    _rendezvous.WSFactory = Factory

    # A mailbox's nonsense would be a traceback on the terminal; what it means for a
    # call is raised.
    globalLogBeginner.beginLoggingTo([], discardBuffer=True, redirectStandardIO=False)
    reactor.startRunning(installSignalHandlers=False)


def bounded_client() -> Any:
    """Return the library's end of a mailbox, which then prints nothing and ends a call
    at once that was refused."""
    from wormhole._rendezvous import WSClient

    class Client(WSClient):  # type: ignore[misc]
        def onMessage(self, payload: bytes, isBinary: bool) -> None:  # noqa: N802
            try:
                if (said := json.loads(payload))["type"] == "error":
                    raise ServerError(
                        str(said["error"])
                    )  # else the library asks the mailbox to close, and waits
                self._RC.ws_message(payload)
            except Exception as error:  # whatever a mailbox's words lead the library to
                self._RC._B.error(error)

    return Client


def uninstall() -> None:
    """End Twisted's threads, which would keep the process alive."""
    from twisted.internet import reactor

    reactor.fireSystemEvent("shutdown")


def code_of(secret: bytes) -> str:
    """Return the code that two ends derive from the secret of their last call."""
    number = int.from_bytes(
        hmac.digest(secret, b"tactophone call number", hashlib.sha256)[:5]
    )
    return f"{1_000_000 + number}-{hmac.digest(secret, b'tactophone call words', hashlib.sha256).hex()}"


class Exchange:
    """One exchange through the mailbox at a URL; a context manager of asyncio."""

    def __init__(self, mailbox: str) -> None:
        from twisted.internet import reactor

        self._mailbox, self._loop = mailbox, asyncio.get_running_loop()
        with self._explained():
            self._wormhole: Any = wormhole.create(APPLICATION, mailbox, reactor)

    async def __aenter__(self) -> "Exchange":
        return self

    async def __aexit__(self, *_: object) -> None:
        # It frees the number of the code; errors of the exchange were raised before.
        with contextlib.suppress(Exception):
            async with asyncio.timeout(1.0):
                await self._wait(self._wormhole.close())

    async def open(self, code: str = "") -> str:
        """Reserve a new code, or use one; return it."""
        with self._explained():
            async with asyncio.timeout(WELCOME_TIMEOUT):
                await self._wait(self._wormhole.get_welcome())
                if code:
                    self._wormhole.set_code(code)
                else:
                    self._wormhole.allocate_code(2)
                return plain(str(await self._wait(self._wormhole.get_code())))[
                    :LONGEST_CODE
                ]

    async def meet(self) -> bytes:
        """Wait until the other end uses the same code; return a secret that both now
        share."""
        with self._explained():
            await self._wait(self._wormhole.get_verifier())
            return bytes(
                self._wormhole.derive_key("tactophone call secret", SECRET_SIZE)
            )

    async def receive(self) -> Message:
        with self._explained():
            return read_message(bytes(await self._wait(self._wormhole.get_message())))

    def send(self, message: Message) -> None:
        self._wormhole.send_message(write_message(message))

    async def _wait(self, deferred: Any) -> Any:
        return await deferred.asFuture(self._loop)

    @contextlib.contextmanager
    def _explained(self) -> Iterator[None]:
        try:
            yield
        except WrongPasswordError:
            raise DeviceError(
                "the code is wrong, or somebody else tried it; it is used up: run `tactophone call` for a new one"
            ) from None
        except KeyFormatError:
            raise DeviceError(
                "a code is a number and two words, such as 3-escapade-peachy: check it"
            ) from None
        except TimeoutError:
            raise DeviceError(
                f"the mailbox {self._mailbox} has said nothing for {WELCOME_TIMEOUT:g} s; check the network, or name "
                "another with --set call.mailbox=..."
            ) from None
        except LonelyError:
            raise DeviceError(
                "nobody else used this code: check it, and whether the other end still waits"
            ) from None
        except TactophoneError:
            raise
        except Exception as error:  # its words reach the state machines of a library that raise whatever they raise
            raise DeviceError(
                f"the mailbox {self._mailbox} does not serve this call ({_words(error)}); check the network, or name "
                "another with --set call.mailbox=..."
            ) from None


def _words(error: Exception) -> str:
    reason = getattr(error, "reason", None) or getattr(error, "args", ("",))
    return (
        plain(str(reason[0] if isinstance(reason, tuple) and reason else reason))[:160]
        or type(error).__name__
    )
