"""An object of the user's whose ``step`` C calls: what fails there is raised after the run."""

from __future__ import annotations

from typing import Any

import numpy as np

from ambkit.base.errors import AmbkitError
from ambkit.base.own_class import class_of, made, name_of


class OwnStep:
    """An object with ``step``, made anew for a run."""

    def __init__(self, make: Any, machine: Any, call: str, returns: str) -> None:
        self.name = name_of(make)
        self.wrapped = made(self.name, class_of(make), machine)
        self._call, self._returns, self._sample = call, returns, 0
        self._failed: BaseException | None = None

    def numbers(self, count: int, *arguments: Any) -> list[float]:
        """Return what ``step`` does, NaN once it failed: no exception may reach C."""
        if self._failed is None:
            try:
                result = np.ravel(np.asarray(self.wrapped.step(*arguments), float))
                if result.shape != (count,):
                    raise ValueError(f"it returned {result.size} numbers")
                self._sample += 1
                return result.tolist()
            except BaseException as error:  # Ctrl-C too
                self._failed = error
        return [np.nan] * count

    def check(self) -> None:
        """Raise what ``step`` raised."""
        error, self._failed = self._failed, None
        if error is None:
            return
        if not isinstance(error, Exception):
            raise error
        raise AmbkitError(
            f"{self.name}: {self._call} at sample {self._sample}: {type(error).__name__}: "
            f"{error}; it must return {self._returns}"
        ) from error
