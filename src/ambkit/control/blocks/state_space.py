"""A linear system with one input and one output."""

from __future__ import annotations

import math
from collections.abc import Iterator
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BeforeValidator, Field, ValidationInfo, model_validator

from ambkit.base.config import Read
from ambkit.base.config.quantities import Quantity, from_folder
from ambkit.base.errors import AmbkitError
from ambkit.control.blocks.block import Block
from ambkit.data.files.mat import content


def _listed(value: Any) -> Any:
    return value.tolist() if isinstance(value, np.ndarray) else value


INFINITE = 1e8  #: Magnitude beyond which a zero is infinite.

Number = Annotated[float, Field(strict=True, allow_inf_nan=False)]
Vector = Annotated[
    tuple[Number, ...],
    BeforeValidator(lambda value: _listed(value.ravel() if hasattr(value, "ravel") else value)),
]
Rows = Annotated[tuple[tuple[Number, ...], ...], BeforeValidator(_listed)]


class StateSpace(Block):
    """``dx/dt = A x + B e`` and ``iu = C x + D e``, or the same from sample to sample."""

    # In TOML either the matrices or `file`, a MAT-file with them. It is implemented as second-order
    # sections, so its poles must be stable and its static gain finite: integral action belongs to
    # the PID.

    type: Literal["state space"] = "state space"
    A: Rows
    """State matrix (n, n) [1/s], sampled [1]."""
    B: Vector
    """Input matrix (n)."""
    C: Vector
    """Output matrix (n)."""
    D: Number = 0.0
    """Feedthrough."""
    sampling_time: Annotated[float, Quantity("s", "0.1 ms", above=0)] | None = None
    """Sampling time of discrete matrices [s]. By default they are continuous."""

    @model_validator(mode="before")
    @classmethod
    def _from_file(cls, data: Any, info: ValidationInfo) -> Any:
        """Read the matrices A, B, C, D, and T of a sampled system, from a MAT-file."""
        if not isinstance(data, dict) or "file" not in data:
            return data
        path = from_folder(data["file"], info)
        try:
            known = content(path)
        except (AmbkitError, OSError) as error:
            raise ValueError(f"file: {error}") from None
        if missing := [name for name in "ABC" if name not in known]:
            raise ValueError(f"file: {path} has no variable {', '.join(missing)}")
        matrices = {"A": np.atleast_2d(known["A"]).astype(float), "B": known["B"], "C": known["C"]}
        matrices["D"] = np.ravel(known.get("D", 0.0)).item()
        if "T" in known:
            matrices["sampling_time"] = f"{np.ravel(known['T']).item()!r} s"
        return {key: value for key, value in data.items() if key != "file"} | matrices

    @classmethod
    def _contradictions(cls, read: Read) -> Iterator[tuple[str, str]]:
        A, B, C, sampled = map(read, ("A", "B", "C", "sampling_time"))
        if not all(isinstance(item, tuple) for item in (A, B, C)):
            return
        n = len(A)
        if not n or any(len(row) != n for row in A):
            yield "A", "must be square"
            return
        for name, values in (("B", B), ("C", C)):
            if len(values) != n:
                yield name, f"must have {n} values, as A has rows; has {len(values)}"
                return
        poles = np.linalg.eigvals(np.array(A))
        growing = np.abs(poles) - 1 if sampled else poles.real
        if not growing.max() < 0:
            worst = poles[growing.argmax()] + 0
            text = f"its poles must be stable, has {worst:g}; the integral is that of the PID, ki"
            yield "A", text

    @classmethod
    def of(cls, system: Any) -> StateSpace:
        """Return a system of python-control, or any with A, B, C, D and dt."""
        if not hasattr(system, "A"):
            import control

            system = control.ss(system)
        D = np.asarray(system.D, float)
        if D.size != 1:
            raise AmbkitError(
                f"controller.block: a system must have one input and one output; has "
                f"{D.shape[1]} and {D.shape[0]}"
            )
        return cls.model_validate({
            "A": system.A, "B": system.B, "C": system.C, "D": float(D.item()),
            "sampling_time": float(system.dt) if system.dt else None,
        })  # fmt: skip

    def polynomials(self) -> Any:
        """Reject: a system of any order has no second-order polynomials."""
        raise NotImplementedError

    def sections(self, T: float) -> list[list[float]]:
        from scipy import linalg, signal

        if self.sampling_time is not None and not math.isclose(self.sampling_time, T):
            raise AmbkitError(
                f"controller.block: a state space is sampled every {self.sampling_time:g} s; must "
                f"be the sampling time of the loop, {T:g} s"
            )

        A, B, C, D = (np.atleast_2d(of) for of in (self.A, self.B, self.C, self.D))
        B, one = B.T, np.eye(len(A))
        if self.sampling_time is None:
            A, B, C, D, _ = signal.cont2discrete((A, B, C, D), T, method="bilinear")
        nothing = np.zeros_like(B)
        zeros = linalg.eigvals(
            np.block([[A, B], [C, D]]), np.block([[one, nothing], [nothing.T, np.zeros((1, 1))]])
        )
        zeros, poles = zeros[np.abs(zeros) < INFINITE], np.linalg.eigvals(A)
        at_rest = (C @ np.linalg.solve(one - A, B) + D).item()
        gain = at_rest * np.prod(1 - poles).real / np.prod(1 - zeros).real
        late = len(poles) - len(zeros)  # samples of delay, zeros at 0
        rows = signal.zpk2sos([*zeros, *[0.0] * late], poles, gain)
        for _ in range(late):
            row = next(row for row in rows if row[2] == 0)
            row[:3] = 0.0, row[0], row[1]
        return [[*row[:3].tolist(), *row[4:].tolist()] for row in rows]


def as_block(value: Any) -> Any:
    """Convert a system of python-control into a block."""
    if isinstance(value, Block | dict):
        return value
    return StateSpace.of(value) if hasattr(value, "A") or hasattr(value, "num") else value
