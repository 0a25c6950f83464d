"""Runs long work in equal parts, on all cores of this machine or on a Ray cluster."""

from __future__ import annotations

import logging
import multiprocessing
import os
import signal
import socket
from concurrent.futures import FIRST_COMPLETED, Future, ProcessPoolExecutor, as_completed, wait
from typing import TYPE_CHECKING, Any, TypeVar

from adatracker_deploy.core.errors import UsageError, line_of

if TYPE_CHECKING:
    from collections.abc import Callable, Iterator, Sequence

Result = TypeVar("Result")

_CONNECT_S = 5.0


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


def on_ray(work: Callable[..., Result], jobs: Sequence[tuple[Any, ...]], address: str) -> Iterator[Result]:
    """Yield `work(*job)` of each job, whichever is ready first, done by a Ray cluster.

    Args:
        work: a module's function; this package is installed on every node.
        jobs: its arguments.
        address: `HOST:PORT` or `ray://HOST:PORT` of a cluster, `auto` for the one this machine belongs to, or
            `local` for one that is started here and ends with the work.

    Raises:
        UsageError: Ray is not installed, or there is no cluster at the address.
    """
    try:
        import ray
    except ImportError as error:
        raise UsageError("--ray needs Ray: pip install 'adatracker-deploy[ray]'") from error
    here: dict[str, Any] = {"include_dashboard": False, "_node_ip_address": "127.0.0.1"}
    if address not in ("auto", "local"):
        _check_answers(address)  # Ray itself would try for minutes
    try:
        ray.init(address, logging_level=logging.ERROR, **(here if address == "local" else {}))
    except (ConnectionError, ValueError, RuntimeError) as error:
        raise UsageError(f"--ray {address}: no cluster answers: {line_of(error)}") from error
    try:
        task = ray.remote(work)
        # Somewhat more than is worked on, so that no node waits; what is interrupted leaves little behind.
        has: dict[str, float] = ray.cluster_resources()  # type: ignore[no-untyped-call]
        most = round(1.5 * has.get("CPU", 1)) + 1
        under_way: list[Any] = []
        for job in jobs:
            if len(under_way) == most:
                (ready,), under_way = ray.wait(under_way)
                yield ray.get(ready)
            under_way.append(task.remote(*job))
        while under_way:
            (ready,), under_way = ray.wait(under_way)
            yield ray.get(ready)
    finally:
        ray.shutdown()


def _check_answers(address: str) -> None:
    host, _, port = address.removeprefix("ray://").rpartition(":")
    if not host or not port.isdecimal() or int(port) > 65535:
        raise UsageError(f"--ray {address}: expected HOST:PORT, ray://HOST:PORT, auto or local")
    try:
        socket.create_connection((host, int(port)), timeout=_CONNECT_S).close()
    except OSError as error:
        raise UsageError(f"--ray {address}: no cluster answers: {error}") from error
