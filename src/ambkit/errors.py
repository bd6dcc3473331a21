"""Errors that the user can mend: the command line prints them without a traceback."""

from collections.abc import Iterable


class AmbkitError(Exception):
    """Something the user gave cannot be used; the message names it, its place and its limit."""


class ConfigError(AmbkitError):
    """A description (bearing, scenario) that is not valid.

    Parameters
    ----------
    problems : iterable of str
        All that is wrong, one line each: ``file:line: key: what is wrong``.
    title : str
        What was read; printed above the list if there is more than one problem.
    """

    def __init__(self, problems: Iterable[str], title: str = "") -> None:
        self.problems = tuple(problems)
        lines = list(self.problems)
        if len(lines) > 1:
            lines = [f"{len(lines)} problems{f' in {title}' if title else ''}:", *lines]
        super().__init__("\n  ".join(lines))


class RecordError(AmbkitError):
    """A recording that cannot be read, or that lacks what is asked of it."""
