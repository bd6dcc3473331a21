"""Which cases of a test are quick, and which only the long part has."""

from collections.abc import Iterable
from typing import Any

import pytest


def quick(cases: Iterable[Any], of: Iterable[Any], long: Iterable[Any] | None = None) -> list[Any]:
    """Return all cases, those that are not among `of` in the long part alone.

    With `long`, what is not among these either is left to the studies. A case of several
    arguments is a tuple, in all.
    """
    chosen, later = list(of), None if long is None else list(long)
    return [
        case if case in chosen else _marked(case, later is None or case in later) for case in cases
    ]


def _marked(case: Any, long: bool) -> Any:
    arguments = case if isinstance(case, tuple) else (case,)
    return pytest.param(*arguments, marks=pytest.mark.long if long else pytest.mark.study)
