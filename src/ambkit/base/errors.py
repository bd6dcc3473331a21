"""Errors that the user can mend: the command line prints them without a traceback."""

import re
from collections.abc import Iterable
from importlib import import_module
from typing import Any

from ambkit.base.escaping import lines


class AmbkitError(Exception):
    """Something the user gave cannot be used; the message names it, its place and its limit.

    Parameters
    ----------
    message : str
        What is wrong; what a terminal would obey, and not show, is escaped.
    """

    def __init__(self, message: str) -> None:
        super().__init__(lines(message))


TOLD = 10  #: Problems of one file that are told one by one; the rest is counted.


def shortened(problems: list[str], limit: int = TOLD) -> list[str]:
    """Return the first problems, and how many more there are."""
    left = len(problems) - limit
    return [*problems[:limit], f"and {left} more"] if left > 1 else problems


def _count(lines: list[str]) -> int:
    """Return how many problems there are, with those that `shortened` only counts."""
    rest = [match for line in lines if (match := re.fullmatch(r"(?:.*: )?and (\d+) more", line))]
    return len(lines) + sum(int(match[1]) - 1 for match in rest)


class _Problems(AmbkitError):
    """Several mistakes told at once, one line each."""

    def __init__(self, problems: str | Iterable[str], title: str = "") -> None:
        self.problems = (problems,) if isinstance(problems, str) else tuple(problems)
        self.title = title
        lines = list(self.problems)
        if len(lines) > 1:
            lines = [f"{_count(lines)} problems{f' in {title}' if title else ''}:", *lines]
        super().__init__("\n  ".join(lines))


class ConfigError(_Problems):
    """An invalid description: `problems` has a line ``file:line: key: what is wrong`` for each."""


class RecordError(_Problems):
    """A recording that cannot be read, or that lacks what is asked of it; `problems` lists why."""


class ExtraMissing(AmbkitError):
    """A library that only some users need is not installed."""

    def __init__(self, what: str, library: str, extra: str) -> None:
        super().__init__(f"{what}: needs {library}: pip install 'ambkit[{extra}]'")


def library(module: str, what: str, extra: str, name: str = "") -> Any:
    """Import a library that only some users need, or say how it is installed."""
    try:
        return import_module(module)
    except ImportError:
        raise ExtraMissing(what, name or module.partition(".")[0], extra) from None
