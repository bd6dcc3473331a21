"""Threads of BLAS, and garbage collection."""

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
    """Restrict BLAS and LAPACK to the calling thread; a context, or a decorator."""
    # With many small matrices, threads would wait for each other.
    with _libraries().limit(limits=1):
        yield


@contextmanager
def rare_collections() -> Iterator[None]:
    """Run the garbage collector only after many new objects; a context, or a decorator."""
    # The machines of a part live until its end, and Python would scan all modules at each quarter
    # more.
    before = gc.get_threshold()
    gc.set_threshold(RARELY, *before[1:])
    try:
        yield
    finally:
        gc.set_threshold(*before)


@contextmanager
def pool_of(threads: int) -> Iterator[ThreadPoolExecutor]:
    """Yield a pool of threads; Ctrl-C cancels those that wait."""
    pool = ThreadPoolExecutor(threads)
    try:
        yield pool
    finally:
        pool.shutdown(cancel_futures=True)


RARELY = 200_000  #: New objects between two garbage collections.


@cache
def _libraries() -> ThreadpoolController:
    import scipy.linalg  # noqa: F401  SciPy brings a BLAS of its own
    from threadpoolctl import ThreadpoolController

    return ThreadpoolController()
