"""Errors that the user can correct: the command line prints them without a traceback."""

import re
from collections.abc import Iterable
from importlib import import_module
from typing import Any

from ambkit.base.escaping import lines


class AmbkitError(Exception):
    """Invalid input; the message has its name, place and limit.

    Parameters
    ----------
    message : str
        The message; control characters of terminals are escaped.
    """

    def __init__(self, message: str) -> None:
        super().__init__(lines(message))


MAX_REPORTED = 10  #: Maximum number of reported problems of a file; the rest is counted.


def shortened(problems: list[str], limit: int = MAX_REPORTED) -> list[str]:
    """Return the first problems, and the number of the others."""
    left = len(problems) - limit
    return [*problems[:limit], f"and {left} more"] if left > 1 else problems


def _count(lines: list[str]) -> int:
    """Return the number of problems, including those that `shortened` only counts."""
    rest = [match for line in lines if (match := re.fullmatch(r"(?:.*: )?and (\d+) more", line))]
    return len(lines) + sum(int(match[1]) - 1 for match in rest)


class _Problems(AmbkitError):
    """Several errors at once, one per line."""

    def __init__(self, problems: str | Iterable[str], title: str = "") -> None:
        self.problems = (problems,) if isinstance(problems, str) else tuple(problems)
        self.title = title
        lines = list(self.problems)
        if len(lines) > 1:
            lines = [f"{_count(lines)} problems{f' in {title}' if title else ''}:", *lines]
        super().__init__("\n  ".join(lines))


class ConfigError(_Problems):
    """An invalid description: `problems` has a line ``file:line: key: error`` for each."""


class RecordError(_Problems):
    """A record that cannot be read, or lacks required signals; `problems` has the reasons."""


class ExtraMissing(AmbkitError):
    """An optional library that is not installed."""

    def __init__(self, what: str, library: str, extra: str) -> None:
        super().__init__(f"{what}: needs {library}: pip install 'ambkit[{extra}]'")


def library(module: str, what: str, extra: str, name: str = "") -> Any:
    """Import an optional library, or raise an error that states how to install it."""
    try:
        return import_module(module)
    except ImportError:
        raise ExtraMissing(what, name or module.partition(".")[0], extra) from None
