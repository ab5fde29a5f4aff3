"""Work shared out over local processes, one thread each."""

from __future__ import annotations

import os
import threading
import time
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from multiprocessing import get_context
from typing import TypeVar

from kiribench.errors import NotConvergedError

Item = TypeVar("Item")
Result = TypeVar("Result")

_THREADS = (
    "OMP_NUM_THREADS",
    "OPENBLAS_NUM_THREADS",
    "MKL_NUM_THREADS",
    "NUMBA_NUM_THREADS",
)


def in_processes(
    work: Callable[[Item], Result], items: Sequence[Item], jobs: int
) -> Iterator[Result]:
    """The results of ``work`` on every item, in the order in which they are done.

    A script that calls this needs the guard ``if __name__ == "__main__":``, for every process
    imports it. The processes end with their parent, however that ends.

    Args:
        work: a function of a module. items: what it is called with; both are pickled between
            processes of this machine, nothing is kept.
        jobs: number of processes.

    Raises:
        NotConvergedError: ``worker-ended``, the system ended a process, for want of memory
            most likely.
    """
    with _one_thread_each():
        pool = ProcessPoolExecutor(
            min(jobs, max(len(items), 1)),
            mp_context=get_context("spawn"),
            initializer=_end_with_parent,
            initargs=(os.getpid(),),
        )
        try:
            for future in as_completed([pool.submit(work, item) for item in items]):
                yield future.result()
        except BrokenProcessPool as error:
            raise NotConvergedError(
                "worker-ended",
                "The system ended a worker process, for want of memory most likely.",
                remedy="Start again with fewer --jobs; what was finished is kept.",
                got=jobs,
            ) from error
        finally:
            pool.shutdown(cancel_futures=True)


@contextmanager
def _one_thread_each() -> Iterator[None]:
    """Numerical libraries that are loaded by processes started in here use one thread."""
    before = {name: os.environ.get(name) for name in _THREADS}
    os.environ.update(dict.fromkeys(_THREADS, "1"))
    try:
        yield
    finally:
        for name, value in before.items():
            if value is None:
                os.environ.pop(name, None)
            else:
                os.environ[name] = value


def _end_with_parent(parent: int) -> None:
    """Watch the parent: a pool's processes would wait for it for ever after kill -9."""

    def watch() -> None:
        while os.getppid() == parent:
            time.sleep(1.0)
        os._exit(1)

    threading.Thread(target=watch, daemon=True).start()
