"""Which cases of a test are quick, and which only the long part has."""

from collections.abc import Iterable
from typing import Any

import pytest


def quick(cases: Iterable[Any], of: Iterable[Any]) -> list[Any]:
    """Return all cases, those that are not among `of` in the long part alone.

    A case of several arguments is a tuple, in both.
    """
    chosen = list(of)
    return [case if case in chosen else _long(case) for case in cases]


def _long(case: Any) -> Any:
    arguments = case if isinstance(case, tuple) else (case,)
    return pytest.param(*arguments, marks=pytest.mark.long)
