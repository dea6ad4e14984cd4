"""Worker processes for long computations; they end with the process that started them, however that ends."""

import multiprocessing
import os
import threading
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor


def open_pool(workers: int, *, prepare: Callable[[], None] | None = None) -> ProcessPoolExecutor:
    """Return a pool of ``workers`` processes, each of which calls ``prepare`` first.

    They are spawned, not forked: torch and BLAS do not survive a fork once their threads run.
    """
    context = multiprocessing.get_context("spawn")
    return ProcessPoolExecutor(workers, mp_context=context, initializer=_begin, initargs=(prepare,))


def _begin(prepare: Callable[[], None] | None) -> None:
    # The pool alone does not: where its process is killed, its workers finish what they were at and wait for more.
    threading.Thread(target=_end_with_parent, daemon=True).start()
    if prepare is not None:
        prepare()


def _end_with_parent() -> None:
    if parent := multiprocessing.parent_process():
        parent.join()
        os._exit(1)
