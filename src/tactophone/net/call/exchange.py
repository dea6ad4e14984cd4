"""The mailbox: two ends that know one code exchange messages under a key that nobody else learns.

magic-wormhole derives the key with SPAKE2: whoever guesses at a code has one guess, and both ends notice a wrong one.
Its reactor runs in the process's asyncio loop, and once a process.
"""

import asyncio
import contextlib
import hashlib
import hmac
from collections.abc import Iterator
from typing import Any

import wormhole
from twisted.internet import asyncioreactor
from wormhole.errors import KeyFormatError, LonelyError, WormholeClosed, WormholeError, WrongPasswordError

from tactophone.core.errors import DeviceError
from tactophone.net.call.messages import Message, read_message, write_message

APPLICATION = "tactophone.org/call/1"
"""Separates our codes from other programs' in a mailbox that serves many; no address that anybody asks."""

SECRET_SIZE = 32
"""Bytes of the secret from which two ends derive the code of their next call."""


def install(loop: asyncio.AbstractEventLoop) -> None:
    """Let Twisted run in this loop; once a process, before anything else of Twisted is imported."""
    asyncioreactor.install(loop)
    from twisted.internet import reactor

    reactor.startRunning(installSignalHandlers=False)


def uninstall() -> None:
    """End Twisted's threads, which would keep the process alive."""
    from twisted.internet import reactor

    reactor.fireSystemEvent("shutdown")


def code_of(secret: bytes) -> str:
    """Return the code that two ends derive from the secret of their last call."""
    number = int.from_bytes(hmac.digest(secret, b"tactophone call number", hashlib.sha256)[:5])
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
            if code:
                self._wormhole.set_code(code)
            else:
                self._wormhole.allocate_code(2)
            return str(await self._wait(self._wormhole.get_code()))

    async def meet(self) -> bytes:
        """Wait until the other end uses the same code; return a secret that both now share."""
        with self._explained():
            await self._wait(self._wormhole.get_verifier())
            return bytes(self._wormhole.derive_key("tactophone call secret", SECRET_SIZE))

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
            raise DeviceError("a code is a number and two words, such as 3-escapade-peachy: check it") from None
        except LonelyError:
            raise DeviceError("nobody else used this code: check it, and whether the other end still waits") from None
        except (WormholeError, WormholeClosed) as error:
            raise DeviceError(
                f"the mailbox {self._mailbox} does not serve this call ({_words(error)}); check the network, or name "
                "another with --set call.mailbox=..."
            ) from None


def _words(error: Exception) -> str:
    reason = getattr(error, "reason", None) or getattr(error, "args", ("",))
    return str(reason[0] if isinstance(reason, tuple) and reason else reason) or type(error).__name__
