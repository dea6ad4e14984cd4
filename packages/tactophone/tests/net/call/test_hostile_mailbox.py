"""A mailbox that lies in its own words, says none or says too much: an error in words,
in bounded time and memory."""

import asyncio
import json
import multiprocessing
import struct
from typing import Any

import pytest

from tactophone.core.errors import DeviceError

from .calls_apart import results_of

pytest.importorskip("wormhole")

ESCAPES = "\x1b]0;PWNED\x07\x1b[2J\x1b[31m [/x] "
TIMEOUT = 1.0
"""Seconds to wait for a mailbox's first word, in place of 20."""

REFUSED = "does not serve this call"
NOTHING = "has said nothing for 1 s"
MODES = {
    "silent": NOTHING,
    "no number": NOTHING,
    "no JSON": REFUSED,
    "huge": NOTHING,
    "pieces": NOTHING,
    "refused": REFUSED,
    "no hexadecimal": REFUSED,
    "no key": REFUSED,
    "many": REFUSED,
    "endless acks": "it says more than a call needs",
    "endless messages": "it says more than a call needs",
    "endless small words": "it says more than a call needs",
    "error": REFUSED,
    "escapes": "a code is a number and two words",
    "shell": "a code is a number and two words",
    "markup": "a code is a number and two words",
    "long number": "characters, but at most 100 are taken",
}
"""What a mailbox does, and what is said about it."""


async def lie(socket: Any, mode: str) -> None:
    """Be a mailbox, honest but for one thing."""

    async def say(**words: object) -> None:
        await socket.send_str(json.dumps(words))

    match mode:
        case "silent":
            await asyncio.sleep(60)
        case "refused":
            await say(type="welcome", welcome={"error": ESCAPES + "A" * 200})
        case "no JSON":
            await socket.send_str("\x1b[31m{")
        case "huge":
            await say(type="ack", x="A" * 20_000_000)
        case "pieces":  # one message in 100 frames, each of a size that is allowed
            pieces = [b'{"type":"ack","x":"', *[b"A" * 60_000] * 100, b'"}']
            for place, piece in enumerate(pieces):
                head = (0 if place else 1) | (0x80 if place == len(pieces) - 1 else 0)
                socket._writer.transport.write(
                    struct.pack(">BBH", head, 126, len(piece)) + piece
                )
    await say(type="welcome", welcome={"motd": ESCAPES})
    async for message in socket:
        words = json.loads(message.data)
        await say(type="ack", id=words["id"])
        match words["type"], mode:
            case "allocate", "no number":
                pass
            case "allocate", _:
                wrong = {
                    "escapes": f"{ESCAPES}7",
                    "shell": "7;touch PWNED;",
                    "markup": "7[/x]",
                    "long number": 100 * "7",
                }
                await say(type="allocated", nameplate=wrong.get(mode, "7"))
            case "claim", _:
                await say(type="claimed", mailbox="mb")
            case "open", "no hexadecimal":
                await say(type="message", side="x", phase="pake", body="zz")
            case "open", "no key":
                await say(
                    type="message",
                    side="x",
                    phase="pake",
                    body=b'{"pake_v1":"zz"}'.hex(),
                )
            case "open", "error":
                await say(type="error", error=ESCAPES + "crowded", orig={})
            case "open", "endless acks":
                for _ in range(100):
                    await say(type="ack", x="A" * 100_000)
            case "open", "endless messages":
                for number in range(100):
                    body = "00" * 50_000
                    await say(type="message", side="x", phase=str(number), body=body)
            case "open", "endless small words":
                for _ in range(5_000):
                    await say(type="ack")
            case "open", "many":
                for number in range(5_000):
                    await say(
                        type="message", side=f"x{number}", phase="pake", body="00" * 50
                    )


def hostile_calls(results: "multiprocessing.Queue[dict[str, str]]") -> None:
    """Open a call at a mailbox of each kind; in a process of its own, as Twisted starts
    once."""
    from aiohttp import web

    from tactophone.net.call import exchange

    loop = asyncio.new_event_loop()
    asyncio.set_event_loop(loop)
    exchange.install(loop)

    async def answer(request: web.Request) -> web.WebSocketResponse:
        socket = web.WebSocketResponse()
        await socket.prepare(request)
        await lie(socket, request.match_info["mode"].replace("_", " "))
        return socket

    async def call(mode: str, port: int) -> str:
        try:
            async with exchange.Exchange(
                f"ws://127.0.0.1:{port}/{mode.replace(' ', '_')}"
            ) as own:
                await own.open()
                await own.meet()
                return "met"
        except DeviceError as error:
            return str(error)

    async def every() -> dict[str, str]:
        application = web.Application()
        application.router.add_get("/{mode}", answer)
        runner = web.AppRunner(application)
        await runner.setup()
        site = web.TCPSite(runner, "127.0.0.1", 0)
        await site.start()
        port = runner.addresses[0][1]
        # Those that answer one by one, so that none waits for another's bytes; the
        # silent ones at once.
        answering = [mode for mode, wanted in MODES.items() if wanted != NOTHING]
        # The mailbox answers at once, but this machine may not.
        exchange.WELCOME_TIMEOUT = 20 * TIMEOUT
        found = {
            mode: await asyncio.wait_for(call(mode, port), 20 * TIMEOUT)
            for mode in answering
        }
        exchange.WELCOME_TIMEOUT = TIMEOUT
        silent = [mode for mode in MODES if mode not in found]
        calls = (asyncio.wait_for(call(mode, port), 20 * TIMEOUT) for mode in silent)
        return found | dict(zip(silent, await asyncio.gather(*calls), strict=True))

    results.put(loop.run_until_complete(every()))
    exchange.uninstall()


@pytest.mark.slow
def test_a_mailbox_that_misbehaves_ends_the_call_in_time_and_printable_words() -> None:
    found = results_of(hostile_calls)
    for mode, wanted in MODES.items():
        assert wanted in found[mode], mode
        assert found[mode].isprintable(), mode
        assert len(found[mode]) < 400, mode
