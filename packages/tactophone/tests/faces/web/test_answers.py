"""Answers of a command to its pages: one that does not read collects none."""

import asyncio
import json
from collections import deque
from types import SimpleNamespace
from typing import Any, cast

from tactophone.faces.web.views import Answers


class Reader:
    """A page that takes what it was sent when it is told to read."""

    def __init__(self) -> None:
        self.reads = asyncio.Event()
        self.got: list[dict[str, Any]] = []

    async def send_str(self, text: str) -> None:
        await self.reads.wait()
        self.got.append(json.loads(text))


async def answered(count: int) -> tuple[int, list[dict[str, Any]]]:
    """Answer a page that does not read; return how many answers are on the way, and
    what it gets once it reads."""
    orders = deque({"recording": number} for number in range(count))
    page = Reader()
    answers = Answers(
        cast(Any, SimpleNamespace(recv=orders.popleft)), cast(Any, {page})
    )
    while orders:
        answers._take()
        await asyncio.sleep(0)
    waiting = len(answers._sending)
    page.reads.set()
    while answers._sending:
        await asyncio.sleep(0)
    return waiting, page.got


def test_a_page_that_does_not_read_collects_no_answers_and_gets_the_newest() -> None:
    waiting, got = asyncio.run(answered(1_000))
    assert waiting == 1
    assert got == [{"recording": 0}, {"recording": 999}]
