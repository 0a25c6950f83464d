"""Long work in equal parts, on all cores."""

from __future__ import annotations

import multiprocessing
import os
import signal
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, as_completed, wait
from typing import TYPE_CHECKING, Any, TypeVar

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

Result = TypeVar("Result")


def in_processes(
    work: Callable[..., Result], jobs: Sequence[tuple[Any, ...]], workers: int
) -> Iterator[Result]:
    """Yield `work(*job)` of each job, whichever is ready first.

    An interrupt waits for the jobs under way and for no others.

    Args:
        work: a module's function; with its jobs it goes to processes that are spawned.
        jobs: its arguments.
        workers: processes; 1 stays in this one.
    """
    if workers == 1 or len(jobs) <= 1:
        for job in jobs:
            yield work(*job)
        return
    # Read when a worker loads its linear algebra: threads that wait for each other on busy cores cost more
    # than they bring.
    os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")
    workers = min(workers, len(jobs))
    with ProcessPoolExecutor(
        workers,
        mp_context=multiprocessing.get_context("spawn"),
        # An interrupt is this process's affair: the workers finish their jobs and are sent home.
        initializer=signal.signal,
        initargs=(signal.SIGINT, signal.SIG_IGN),
    ) as pool:
        # No more is handed out than is worked on, so that an interrupt need not take anything back.
        under_way: set[Future[Result]] = set()
        for job in jobs:
            if len(under_way) == workers:
                finished, under_way = wait(under_way, return_when=FIRST_COMPLETED)
                yield from (future.result() for future in finished)
            under_way.add(pool.submit(work, *job))
        yield from (future.result() for future in as_completed(under_way))
