"""Runs folds in this process, on the machine's cores, or on a Ray cluster.

A fold is a pure function of its method and its recordings, so it may run wherever both can be read; its predictions are
cached by content. A worker that dies loses the fold it was at: that fold runs again, the others do not.
"""

import importlib.util
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import as_completed
from concurrent.futures.process import BrokenProcessPool
from dataclasses import dataclass
from typing import Any

from tactophone.benchmark.crossvalidation import Cache, Method, fold_key, predict_fold
from tactophone.dataset import Fold
from tactophone.errors import ConfigError
from tactophone.evaluation import TakePredictions
from tactophone.worker_processes import open_pool

MOST_DEATHS = 3
"""Times that workers may die before the run gives up, because a fold kills them."""


@dataclass(frozen=True, slots=True)
class Job:
    """One fold of one method."""

    method: Method
    fold: Fold

    @property
    def key(self) -> str:
        """Cache key of its predictions."""
        return fold_key(self.method, self.fold)


def run_jobs(
    jobs: Sequence[Job],
    cache: Cache,
    *,
    workers: int = 1,
    ray: bool = False,
    report: Callable[[int, str], None] = lambda done, name: None,
) -> int:
    """Run the jobs whose predictions are not cached, and cache them; return how many jobs ran.

    Parameters
    ----------
    jobs
        In any order; each is independent of the others.
    cache
        Where predictions are kept.
    workers
        Processes; one is this process itself.
    ray
        Whether to run on the Ray cluster at ``RAY_ADDRESS``, or on a local one of as many processes.
    report
        Called with the number of jobs done, and the name of the last one.

    Raises
    ------
    ConfigError
        If Ray is chosen and not installed.
    """
    todo = {job.key: job for job in jobs}
    todo = {key: job for key, job in todo.items() if not cache.holds(key)}
    run = _ray if ray else _processes if workers > 1 else _here
    for done, (job, predictions) in enumerate(run(list(todo.values()), workers), 1):
        cache.put(job.key, predictions)
        report(done, f"{job.method.name}, {job.fold.name}")
    return len(todo)


def _run(job: Job) -> list[TakePredictions]:
    return predict_fold(job.method, job.fold)


def _here(jobs: Sequence[Job], workers: int) -> Iterator[tuple[Job, list[TakePredictions]]]:
    del workers
    yield from ((job, _run(job)) for job in jobs)


def _processes(jobs: Sequence[Job], workers: int) -> Iterator[tuple[Job, list[TakePredictions]]]:
    left, deaths = list(jobs), 0
    while left:
        try:
            for job, predictions in _pool(left, workers):
                left.remove(job)
                yield job, predictions
        except BrokenProcessPool:
            deaths += 1
            if deaths >= MOST_DEATHS:
                raise


def _pool(jobs: Sequence[Job], workers: int) -> Iterator[tuple[Job, list[TakePredictions]]]:
    with open_pool(workers, prepare=_use_single_thread) as pool:
        futures = {pool.submit(_run, job): job for job in jobs}
        try:
            for future in as_completed(futures):
                yield futures[future], future.result()
        finally:
            pool.shutdown(cancel_futures=True)


def _use_single_thread() -> None:
    """One thread per worker, because there are as many workers as cores."""
    if importlib.util.find_spec("torch"):
        import torch

        torch.set_num_threads(1)


def _ray(jobs: Sequence[Job], workers: int) -> Iterator[tuple[Job, list[TakePredictions]]]:
    ray = load_ray(workers)
    # Ray runs a task again if its worker or its machine dies.
    remote = ray.remote(num_cpus=1, max_retries=MOST_DEATHS)(_run)
    running = {remote.remote(job): job for job in jobs}
    while running:
        (ready,), _ = ray.wait(list(running), num_returns=1)
        yield running.pop(ready), ray.get(ready)


def load_ray(workers: int) -> Any:
    """Import Ray and join the cluster at ``RAY_ADDRESS``, or start one on this machine.

    Raises `ConfigError` if Ray is not installed.
    """
    if importlib.util.find_spec("ray") is None:
        raise ConfigError("Ray is not installed: pip install 'tactophone[ray]', or leave --ray away")
    import os

    import ray

    if not ray.is_initialized():
        local = {} if os.environ.get("RAY_ADDRESS") else {"num_cpus": workers, "include_dashboard": False}
        ray.init(log_to_driver=False, logging_level="warning", **local)
    return ray
