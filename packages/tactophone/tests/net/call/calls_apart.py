"""Calls in a process of their own, as Twisted starts once."""

import multiprocessing
from collections.abc import Callable
from typing import Any


def results_of(work: "Callable[[multiprocessing.Queue[Any]], None]") -> Any:
    """Return what ``work`` puts into its queue, in a new process."""
    context = multiprocessing.get_context("spawn")
    results = context.Queue()
    process = context.Process(target=work, args=(results,), daemon=True)
    process.start()
    found = results.get(timeout=60)
    process.join(10)
    return found
