"""A linear system with one input and one output."""

from __future__ import annotations

import math
from abc import abstractmethod
from collections.abc import Iterator
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import BeforeValidator, Field, ValidationInfo, model_validator

from ambkit.base.config import Part, Read
from ambkit.base.config.quantities import Quantity, from_folder
from ambkit.base.errors import AmbkitError
from ambkit.data.files.mat import content


class Block(Part):
    """A filter of one signal, defined in continuous time."""

    @abstractmethod
    def polynomials(self) -> tuple[tuple[float, float, float], tuple[float, float, float]]:
        """Return numerator and denominator by powers of s: s^2, s, 1."""

    @property
    def exact(self) -> float:
        """Frequency at which the sampled filter equals the continuous one [Hz]; 0: static."""
        return float(getattr(self, "frequency", 0.0))

    def sections(self, T: float) -> list[list[float]]:
        """Return the sections b0, b1, b2, a1, a2 at a sampling time [s]."""
        # By the bilinear transformation, prewarped to `exact` (Franklin, Powell and Workman 1998,
        # section 6.1).
        f = self.exact
        if not f < 0.5 / T:
            raise AmbkitError(
                f"controller.block: {getattr(self, 'type', '')} at {f:.6g} Hz must be below half "
                f"the sampling frequency, {0.5 / T:.6g} Hz"
            )
        c = 2 / T if f == 0 else 2 * math.pi * f / math.tan(math.pi * f * T)
        polynomials = self.polynomials()
        if not any(p for p, _, _ in polynomials):  # of first order: no pole and zero at z = -1
            (b0, b1), (a0, a1) = ((q * c + r, r - q * c) for _, q, r in polynomials)
            return [[b0 / a0, b1 / a0, 0.0, a1 / a0, 0.0]]
        (b0, b1, b2), (a0, a1, a2) = (
            (p * c * c + q * c + r, 2 * (r - p * c * c), p * c * c - q * c + r)
            for p, q, r in polynomials
        )
        return [[b0 / a0, b1 / a0, b2 / a0, a1 / a0, a2 / a0]]


class Biquad(Block):
    """``(s^2/w_z^2 + 2 d_z s/w_z + 1) / (s^2/w_p^2 + 2 d_p s/w_p + 1)``."""

    type: Literal["biquad"] = "biquad"
    zero_frequency: Annotated[float, Quantity("Hz", "85 Hz", above=0)]
    """Frequency of the zeros [Hz]."""
    zero_damping: Annotated[float, Quantity("1", "0.05")]
    """Damping ratio of the zeros [1]; negative in the right half-plane."""
    pole_frequency: Annotated[float, Quantity("Hz", "120 Hz", above=0)]
    """Frequency of the poles [Hz]."""
    pole_damping: Annotated[float, Quantity("1", "0.5", above=0)]
    """Damping ratio of the poles [1]."""

    @property
    def exact(self) -> float:
        return self.pole_frequency

    def polynomials(self) -> tuple[tuple[float, float, float], tuple[float, float, float]]:
        z, p = 2 * math.pi * self.zero_frequency, 2 * math.pi * self.pole_frequency
        above = z**-2, 2 * self.zero_damping / z, 1.0
        return above, (p**-2, 2 * self.pole_damping / p, 1.0)


class LeadLag(Block):
    """``(1 + s/w_z) / (1 + s/w_p)``: a lead where the zero is below the pole, else a lag."""

    type: Literal["lead-lag"] = "lead-lag"
    zero: Annotated[float, Quantity("Hz", "60 Hz", above=0)]
    """Corner of the numerator [Hz]."""
    pole: Annotated[float, Quantity("Hz", "600 Hz", above=0)]
    """Corner of the denominator [Hz]."""

    def polynomials(self) -> tuple[tuple[float, float, float], tuple[float, float, float]]:
        corner = 2 * math.pi
        return (0.0, 1 / (corner * self.zero), 1.0), (0.0, 1 / (corner * self.pole), 1.0)


class Notch(Block):
    """``(s^2 + 2 depth d w s + w^2) / (s^2 + 2 d w s + w^2)``, such as for a bending mode."""

    type: Literal["notch"] = "notch"
    frequency: Annotated[float, Quantity("Hz", "85 Hz", above=0)]
    """Centre frequency [Hz]."""
    damping: Annotated[float, Quantity("1", "0.2", above=0)] = 0.2
    """Damping ratio d of its poles, half its relative width [1]."""
    depth: Annotated[float, Quantity("1", "0.1", at_least=0)] = 0.0
    """Gain at the centre frequency [1]."""

    def polynomials(self) -> tuple[tuple[float, float, float], tuple[float, float, float]]:
        w = 2 * math.pi * self.frequency
        wide = 2 * self.damping * w
        return (1.0, self.depth * wide, w * w), (1.0, wide, w * w)


class SecondOrder(Block):
    """``w^2 / (s^2 + 2 d w s + w^2)``."""

    type: Literal["second-order"] = "second-order"
    frequency: Annotated[float, Quantity("Hz", "1.5 kHz", above=0)]
    """Corner frequency [Hz]."""
    damping: Annotated[float, Quantity("1", "0.7", above=0)] = 0.7
    """Damping ratio d [1]."""

    def polynomials(self) -> tuple[tuple[float, float, float], tuple[float, float, float]]:
        w = 2 * math.pi * self.frequency
        return (0.0, 0.0, w * w), (1.0, 2 * self.damping * w, w * w)


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
