"""Progress: a bar on a terminal or in a notebook; lines if a command writes to a pipe."""

import sys
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from typing import Any

from ambkit.base import escaping

Step = Callable[..., None]  #: Called after each step, with a text on the next one.
_LINES_APART = 5.0  # s between two lines
_REDRAWN = 0.1  # s between two updates in a notebook; each one is a message to the browser


@contextmanager
def progress(
    what: str, total: int | None = None, *, unit: str = "", begun: int = 0
) -> Iterator[Step]:
    """Show progress: in a notebook below its cell, else on stderr (of a library if a terminal)."""
    notebook = in_notebook()
    if not notebook and not sys.stderr.isatty():
        yield _in_lines(what, total, unit, begun) if any(of_a_command) else silent
        return
    from rich import progress as rich
    from rich.console import Console

    text = rich.TextColumn("{task.description}", markup=False)
    columns: list[rich.ProgressColumn] = [text, rich.BarColumn(), rich.TimeElapsedColumn()]
    rate = Rate(unit)
    if unit:
        columns.append(rich.TextColumn("{task.fields[rate]}", markup=False))
    if notebook:
        bar = rich.Progress(*columns, disable=True)  # rich itself would need widgets there
        display: AbstractContextManager[Callable[[], None]] = _below_the_cell(bar)
    else:
        columns.insert(0, rich.SpinnerColumn())
        bar = rich.Progress(*columns, console=Console(stderr=True), transient=True)
        display = nullcontext(lambda: None)
    with bar, display as redraw:
        task = bar.add_task(escaping.one_line(what), total=total, completed=begun, rate="")
        redraw()

        def tell(text: str = "", steps: int = 1) -> None:
            rate_text = rate.text(steps, total, begun)
            description = escaping.one_line(text or what)
            bar.update(task, advance=steps, description=description, rate=rate_text)
            redraw()

        yield tell


class Rate:
    """Speed of the steps, and remaining time."""

    def __init__(self, unit: str) -> None:
        self.unit, self.start, self.done = unit, time.monotonic(), 0

    def text(self, steps: int, total: int | None, begun: int = 0) -> str:
        """Count steps, and return their number, rate and remaining time in words."""
        self.done += steps
        rate = self.done / max(time.monotonic() - self.start, 1e-9)
        of = "" if total is None else f" of {total:,}"
        text = f"{begun + self.done:,}{of} {self.unit}, {rate:,.3g}/s"
        if total is None:
            return text
        return f"{text}, {duration((total - begun - self.done) / rate)} left"


def duration(seconds: float) -> str:
    """Return a time in words: 45 s, 3 min, 2 h 05 min."""
    rounded_seconds = round(seconds)
    if rounded_seconds < 120:
        return f"{rounded_seconds} s"
    hours, minutes = divmod(round(seconds / 60), 60)
    return f"{hours} h {minutes:02d} min" if hours else f"{minutes} min"


def in_notebook() -> bool:
    """Return whether it runs in a notebook: Jupyter, JupyterLab, VS Code, Colab."""
    ask = getattr(sys.modules.get("IPython"), "get_ipython", None)
    return ask is not None and getattr(ask(), "kernel", None) is not None


of_a_command: list[bool] = []  #: Whether the process is a command, once known.


def _in_lines(what: str, total: int | None, unit: str, begun: int) -> Step:
    """Return a function that writes a line to stderr from time to time."""
    rate, last, lock = Rate(unit), time.monotonic(), threading.Lock()

    def tell(text: str = "", steps: int = 1) -> None:
        nonlocal last
        with lock:
            rate_text = rate.text(steps, total, begun) if unit else ""
            if time.monotonic() - last < _LINES_APART:
                return
            last = time.monotonic()
            named = text if text.startswith(what) else ": ".join(filter(None, (what, text)))
            parts = filter(None, (named, rate_text))
            print(escaping.one_line(": ".join(parts)), file=sys.stderr, flush=True)

    return tell


def silent(_text: str = "", steps: int = 1) -> None:
    """Report nothing."""


left: list[str] = []  #: State of an interrupted command.


@contextmanager
def interrupted_says(text: str) -> Iterator[None]:
    """Report a state if the command is interrupted within this context."""
    left.append(text)
    yield
    left.pop()


@contextmanager
def _below_the_cell(bar: Any) -> Iterator[Callable[[], None]]:
    """Show a bar as an output that is updated, and removed at the end."""
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
