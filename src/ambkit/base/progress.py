"""How far work is: a bar where a human looks, on a terminal or in a notebook."""

from __future__ import annotations

import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from functools import wraps
from typing import Any, ParamSpec, TypeVar

from ambkit.base import escaping

Told = Callable[..., None]
"""Called after each step, with a text that says what is done next."""

Wanted = ParamSpec("Wanted")
Result = TypeVar("Result")

_REDRAWN = 0.1  # s between two pictures in a notebook; each one is a message to the browser


@contextmanager
def progress(what: str, total: int | None = None) -> Iterator[Told]:
    """Show how far the work is: in a notebook below its cell, else on stderr if it is a terminal.

    Parameters
    ----------
    what : str
        What is done, until a step says what is next.
    total : int, optional
        Number of steps; without it the bar only moves.

    Yields
    ------
    callable
        To be called after each of the `total` steps, with a text that says what is done next.
    """
    notebook = in_notebook()
    if not notebook and not sys.stderr.isatty():
        yield _silent
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, SpinnerColumn, TextColumn, TimeElapsedColumn

    text = TextColumn("{task.description}", markup=False)
    columns = [text, BarColumn(), TimeElapsedColumn()]
    if notebook:
        bar = Progress(*columns, disable=True)  # rich itself would need widgets there
        shown: AbstractContextManager[Callable[[], None]] = _below_the_cell(bar)
    else:
        console = Console(stderr=True)
        bar = Progress(SpinnerColumn(), *columns, console=console, transient=True)
        shown = nullcontext(lambda: None)
    with bar, shown as redraw:
        task = bar.add_task(escaping.one_line(what), total=total)
        redraw()

        def tell(text: str = "") -> None:
            bar.update(task, advance=1, description=escaping.one_line(text or what))
            redraw()

        yield tell


def reporting(
    done: Callable[..., None] | None, what: str, total: int | None = None
) -> AbstractContextManager[Told]:
    """Give what the caller of a function wants to be told by; in a notebook a bar, else nothing.

    Parameters
    ----------
    done : callable, optional
        The caller's own.
    what, total
        See `progress`.
    """
    if done is None and in_notebook():
        return progress(what, total)
    return nullcontext(done or _silent)


def shown_in_notebooks(
    what: str, by: str
) -> Callable[[Callable[Wanted, Result]], Callable[Wanted, Result]]:
    """Decorate a function that tells how far it is: a notebook shows a bar where nobody is told.

    Parameters
    ----------
    what : str
        See `progress`.
    by : str
        The function's keyword for who is told.
    """

    def decorate(work: Callable[Wanted, Result]) -> Callable[Wanted, Result]:
        @wraps(work)
        def shown(*args: Wanted.args, **kwargs: Wanted.kwargs) -> Result:
            if by in kwargs or not in_notebook():
                return work(*args, **kwargs)
            with progress(what) as tell:
                kwargs[by] = tell
                return work(*args, **kwargs)

        return shown

    return decorate


def in_notebook() -> bool:
    """Whether a notebook looks on: Jupyter, JupyterLab, VS Code, Colab."""
    ask = getattr(sys.modules.get("IPython"), "get_ipython", None)
    return ask is not None and getattr(ask(), "kernel", None) is not None


def _silent(_text: str = "") -> None:
    pass


@contextmanager
def _below_the_cell(bar: Any) -> Iterator[Callable[[], None]]:
    """Show a bar as an output that is drawn anew, and take it away at the end."""
    from IPython.display import display

    lock, last = threading.Lock(), 0.0  # steps may come from several threads
    handle = display(bar, display_id=True)

    def redraw() -> None:
        nonlocal last
        with lock:
            if time.monotonic() - last >= _REDRAWN:
                last = time.monotonic()
                handle.update(bar)

    try:
        yield redraw
    finally:
        handle.update({"text/plain": "", "text/html": ""}, raw=True)
