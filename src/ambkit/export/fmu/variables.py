"""The variables of each kind of model: one table for the XML, the C and the documentation."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING, Literal

if TYPE_CHECKING:
    from ambkit.estimators import KalmanFilter

Kind = Literal["estimator", "plant", "closed-loop"]
Role = Literal["time", "fixed", "tunable", "input", "output"]
Limit = Literal["any", "not negative", "positive"]


@dataclass(frozen=True)
class Variable:
    """A variable of a model; its value reference is its place in the table.

    Attributes
    ----------
    name : str
        As the importer shows it.
    role : {"time", "fixed", "tunable", "input", "output"}
        Fixed parameters hold from the start, tunable ones can be changed between steps.
    unit : str
        As in `UNITS`; empty for integers.
    about : str
        In a few words.
    start : float
        Start value; of an output, nothing.
    limit : {"any", "not negative", "positive"}
        Of a value that is set.
    follows : tuple of str
        Inputs and parameters that an output follows at once, not with the next step.
    held : bool
        Changes only with a sample.
    """

    name: str
    role: Role
    unit: str
    about: str
    start: float = 0.0
    limit: Limit = "any"
    follows: tuple[str, ...] = ()
    held: bool = False

    @property
    def integer(self) -> bool:
        """Whether it is a whole number: those have no unit."""
        return not self.unit

    @property
    def reference(self) -> str:
        """Name of its value reference in C."""
        return "VR_" + self.name.replace(".", "_")


UNITS: dict[str, dict[str, int]] = {
    "s": {"s": 1},
    "m": {"m": 1},
    "m2": {"m": 2},
    "m/s": {"m": 1, "s": -1},
    "kg": {"kg": 1},
    "A": {"A": 1},
    "A/m": {"A": 1, "m": -1},
    "A/(m.s)": {"A": 1, "m": -1, "s": -1},
    "A.s/m": {"A": 1, "m": -1, "s": 1},
    "V": {"kg": 1, "m": 2, "s": -3, "A": -1},
    "V2": {"kg": 2, "m": 4, "s": -6, "A": -2},
    "N": {"kg": 1, "m": 1, "s": -2},
    "N/A": {"kg": 1, "m": 1, "s": -2, "A": -1},
    "N/m": {"kg": 1, "s": -2},
    "N2/s": {"kg": 2, "m": 2, "s": -5},
    "N.m2/A2": {"kg": 1, "m": 3, "s": -2, "A": -2},
}
"""Exponents of the SI base units in each unit."""

TIME = Variable("time", "time", "s", "time")


def of_estimator(estimator: KalmanFilter) -> tuple[Variable, ...]:
    """Return the variables of an estimator."""
    return (
        TIME,
        Variable("y", "input", "m", "measured position"),
        Variable("u", "input", "V", "control signal"),
        *_estimates("", held=True),
        *_variances(estimator),
    )


def _estimates(prefix: str, *, held: bool) -> list[Variable]:
    texts = (
        ("x", "m", "estimated displacement"),
        ("v", "m/s", "estimated velocity"),
        ("f_d", "N", "estimated disturbance force"),
        ("x_m", "m", "estimated position as the sensor shows it"),
        ("k_i", "N/A", "current stiffness that the prediction used"),
        ("k_s", "N/m", "position stiffness that the prediction used"),
        ("innovation", "m", "measurement less its prediction, 0 where it was not used"),
        ("variance", "m2", "variance of the innovation, as the filter expects it"),
        ("status", "", "sum of flags, 0 where all is well (sources/ambkit/status.h)"),
    )
    return [
        Variable(prefix + name, "output", unit, about, held=held) for name, unit, about in texts
    ]


def _variances(estimator: KalmanFilter) -> list[Variable]:
    assumed = estimator.variances
    return [
        Variable(
            "measurement_variance",
            "tunable",
            "m2",
            "variance of the measurement that the filter assumes",
            assumed.measurement,
            "positive",
        ),
        Variable(
            "control_variance",
            "tunable",
            "V2",
            "variance of the control signal that the filter assumes",
            assumed.control,
            "not negative",
        ),
        Variable(
            "disturbance_growth",
            "tunable",
            "N2/s",
            "growth of the disturbance force's variance that the filter assumes",
            assumed.disturbance,
            "not negative",
        ),
    ]
