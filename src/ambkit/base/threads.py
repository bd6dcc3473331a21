"""What Python and its libraries do beside the work: threads of BLAS, garbage collections."""

from __future__ import annotations

import gc
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from contextlib import contextmanager
from functools import cache
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from threadpoolctl import ThreadpoolController


@contextmanager
def one_thread() -> Iterator[None]:
    """Let BLAS and LAPACK compute in the thread that calls them; a context, or a decorator."""
    # Where matrices are small and many, threads would wait for each other.
    with _libraries().limit(limits=1):
        yield


@contextmanager
def rare_collections() -> Iterator[None]:
    """Let the garbage collector run only after many new objects; a context, or a decorator."""
    # The machines of a part live until its end, and Python would look through the modules, too,
    # each time a quarter more of them are there.
    before = gc.get_threshold()
    gc.set_threshold(RARELY, *before[1:])
    try:
        yield
    finally:
        gc.set_threshold(*before)


@contextmanager
def pool_of(threads: int) -> Iterator[ThreadPoolExecutor]:
    """Give a pool of threads; after Ctrl-C, what still waits is not run first."""
    pool = ThreadPoolExecutor(threads)
    try:
        yield pool
    finally:
        pool.shutdown(cancel_futures=True)


RARELY = 200_000  #: New objects until the garbage collector runs.


@cache
def _libraries() -> ThreadpoolController:
    import scipy.linalg  # noqa: F401  SciPy brings a BLAS of its own
    from threadpoolctl import ThreadpoolController

    return ThreadpoolController()
