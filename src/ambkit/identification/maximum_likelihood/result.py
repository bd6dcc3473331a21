"""Result of maximum likelihood: parameters with errors, and what could not be identified."""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from ambkit.base.arrays import Array
from ambkit.base.errors import AmbkitError
from ambkit.base.units import engineering, figure
from ambkit.identification.maximum_likelihood.current_state import CurrentState
from ambkit.identification.maximum_likelihood.figures import correlation_figure, estimates_figure
from ambkit.identification.maximum_likelihood.loop_model import LoopModel
from ambkit.identification.maximum_likelihood.parameters import (
    DESCRIBED,
    OFFSETS,
    Coordinates,
    Parameter,
    named,
)
from ambkit.identification.maximum_likelihood.search import RULED_OUT
from ambkit.identification.noise import with_steps
from ambkit.machine.accessories import Hum
from ambkit.machine.machine import Machine
from ambkit.machine.magnets import magnet_of
from ambkit.result.report import Figure
from ambkit.result.result import Result
from ambkit.result.row import Row, Section, put

MOSTLY = 0.95  #: Share of the information above which a prior is not reported.
TOGETHER = 0.9  #: Correlation above which two parameters are only determined jointly.
FAR = 3.0  #: Ratio to the description beyond which it is probably another machine.
CONFIDENCE = 1.959964  #: Standard errors on either side that contain 95 %.


@dataclass(frozen=True, eq=False, repr=False)
class MaximumLikelihood(Result):
    """Maximum likelihood estimates of p parameters."""

    start: LoopModel  #: Initial model, as given by the user, and identified model.
    model: LoopModel
    parameters: list[Parameter]  #: Identified parameters.
    values: Array  #: (p,) Their values, SI.
    #: (p,) Standard errors in the search: relative (of the logarithm) for a positive parameter,
    #: otherwise SI. Each is the larger of that by the curvature of the likelihood and of
    #: `robust_errors`; a prior of the current's offset is included, and nothing unknown is taken as
    #: known.
    errors: Array
    #: (p,) The same by the scatter of the scores (White 1982): valid to first order for a wrong
    #: model too, and then larger.
    robust_errors: Array
    covariance: Array  #: (p, p) Covariance that `errors` are the roots of.
    correlation: Array  #: (p, p) Of the estimates.
    #: Parameters that could not be identified, with reasons.
    held: Mapping[str, str]
    log_likelihood: float  #: Log likelihood at the model and at the start.
    start_log_likelihood: float
    samples: int  #: Number of counted measurements.
    #: Best start of the search: the given machine, ADALINE or least squares.
    started_from: str
    steps: int  #: Number of steps of the search.
    converged: bool  #: Whether it reached a maximum.
    #: (p,) Share of each parameter's precision due to the records rather than the prior: 1 without
    #: prior, near 0 for an offset on which the records have no information.
    record_share: Array
    #: (float, float) Ends of the 95 % intervals in the parameter's unit, by the profile likelihood,
    #: if the likelihood is not quadratic.
    profiles: Mapping[str, tuple[float, float]]
    touched: Sequence[str]  #: Limits that the search reached, in sentences.
    remarks: Sequence[str]  #: Remarks on the records, in sentences.
    #: Smoothed current, if records have control signal and measured current.
    current: CurrentState | None
    settling: float = field(default=0.0)
    #: Smallest quantisation step of ``y`` in the records [m]; None if there is none.
    position_step: float | None = None

    @property
    def isolated(self) -> Machine:
        """The identified machine: its delay if `delay_counts`, current lag, quantisation."""
        has_noise = any(p.name == "measurement_noise" for p in self.parameters)
        late = self.model.delayed_machine(delay=self.delay_counts)
        return with_steps(late, self.position_step, has_noise=has_noise)

    @property
    def lines(self) -> Sequence[Hum]:
        """Identified line noise of the position, besides that of the machine."""
        return self.model.isolated.sensor.hum[len(self.start.isolated.sensor.hum) :]

    @property
    def delay_counts(self) -> bool:
        """Whether the delay is the machine's: it was given, or it is identified and significant."""
        if self.model.delayed_machine().delay is None:
            return False  # below zero, or longer than any machine's
        free = any(p.name == "delay" for p in self.parameters)
        delay_known = self.start.isolated.delay is not None or not free
        return delay_known or self.interval("delay")[0] > 0

    @property
    def offsets_count(self) -> bool:
        """Whether the offsets are significant: zero is rejected for all of them together."""
        # An unknown disturbance hides them: the values may be many times the sensor's noise, and
        # insignificant. Offsets that were given and not searched are included.
        at = [i for i, p in enumerate(self.parameters) if p.name in OFFSETS]
        if not at:
            return True
        off = self.values[at]
        return float(off @ np.linalg.solve(self.covariance[np.ix_(at, at)], off)) > 2 * RULED_OUT

    def __getitem__(self, name: str) -> float:
        """Return the value of a parameter, identified or held [SI]."""
        return named([name])[0].of(self.model)

    def standard_error(self, name: str, *, robust: bool = False) -> float:
        """Return the standard error of an identified parameter, in its own unit."""
        at = self._place(name)
        error = float((self.robust_errors if robust else self.errors)[at])
        return error * float(self.values[at]) if self.parameters[at].positive else error

    def error_text(self, p: Parameter) -> str:
        """Return the standard error of a parameter as text, in the unit of its value."""
        return engineering(self.standard_error(p.name), p.unit, 2, like=self[p.name])

    def interval(self, name: str) -> tuple[float, float]:
        """Return the ends of a parameter's 95 % interval, in its own unit."""
        at = self._place(name)
        if name in self.profiles:
            return self.profiles[name]
        value, half = float(self.values[at]), CONFIDENCE * float(self.errors[at])
        if self.parameters[at].positive:
            return value * math.exp(-half), value * math.exp(half)
        return value - half, value + half

    def stiffness(self, iu: float = 0.0, x: float = 0.0) -> dict[str, tuple[float, float]]:
        """Return tangents k_i [N/A] and k_s [N/m] at an operating point, with standard errors."""
        at = self.stiffness_map([iu], [x])
        return {name: (float(v[0, 0]), float(e[0, 0])) for name, (v, e) in at.items()}

    def stiffness_map(
        self, currents: ArrayLike, displacements: ArrayLike
    ) -> dict[str, tuple[Array, Array]]:
        """Return tangents k_i [N/A] and k_s [N/m] over operating points, with standard errors."""
        # currents (ni,) [A]; displacements (nx,) [m]

        coordinates = Coordinates(self.model, self.parameters)
        iu, x = np.meshgrid(currents, displacements)

        def at(z: Array) -> Array:
            return np.array(magnet_of(coordinates.model_at(z).isolated).tangent(iu, x))

        steps = 1e-5 * np.eye(len(self.parameters))
        slopes = np.array([(at(step) - at(-step)) / 2e-5 for step in steps])
        unit = coordinates.unit_steps()
        covariance = self.covariance / np.outer(unit, unit)
        errors = np.sqrt(np.einsum("p...,pq,q...->...", slopes, covariance, slopes))
        values = at(np.zeros(len(self.parameters)))
        return {"k_i": (values[0], errors[0]), "k_s": (values[1], errors[1])}

    TITLE = "Identification of {0.isolated.name}"

    @property
    def finding(self) -> str:
        names = [p.name for p in self.parameters]
        name = "magnet_constant" if "magnet_constant" in names else names[0]
        result = next(row for row in self.rows if row.of == name and row.key == "value")
        return (
            f"{self.isolated.name}: {name.replace('_', ' ')} {result.text()}, by maximum "
            f"likelihood from {self.samples} measurements."
        )

    @property
    def rows(self) -> list[Row]:
        rows: list[Row] = []
        for i, p in enumerate(self.parameters):
            rows += put([
                Row("start", "initial", p.of(self.start), p.unit),
                Row("value", "identified", float(self.values[i]), p.unit, symbol=p.symbol,
                    error=self.standard_error(p.name), interval=self.interval(p.name)),
                Row("robust_standard_error", "robust standard error",
                    self.standard_error(p.name, robust=True), p.unit, 2,
                    like=self[p.name], detail=True),
                Row("told_by_records", "from the records", float(self.record_share[i]), "%",
                    detail=True),
            ], section=("parameters",), of=p.name)  # fmt: skip
        return rows

    @property
    def sections(self) -> dict[tuple[str, ...], Section]:
        title = f"{self.isolated.name}: identified from {self.samples} measurements"
        return {("parameters",): Section(title, across=True)}

    @property
    def notes(self) -> list[str]:
        notes = [
            f"{name.replace('_', ' ')} is not identifiable: {why}."
            for name, why in self.held.items()
        ]
        notes += [
            f"{a.name}, {b.name}: correlation {self.correlation[i, j]:+.2f}; their combination is "
            "more precise than either.".replace("_", " ")
            for i, a in enumerate(self.parameters)
            for j, b in enumerate(self.parameters[:i])
            if abs(self.correlation[i, j]) > TOGETHER
        ]
        notes += [
            f"{p.name.replace('_', ' ')} has a prior of "
            f"{figure(self.model.known[p.name][0], p.unit)} ± "
            f"{figure(self.model.known[p.name][1], p.unit, 2)}: the records contribute "
            f"{100 * self.record_share[i]:.0f} % of the information."
            for i, p in enumerate(self.parameters)
            if p.name in self.model.known and self.record_share[i] < MOSTLY
        ]
        if self.profiles:
            names = ", ".join(self.profiles).replace("_", " ")
            notes.append(
                f"The likelihood is not quadratic in {names}: the intervals are profile likelihood "
                "intervals, not 1.96 standard errors."
            )
        notes += [
            f"A line of {figure(line.amplitude, 'm', 2)} at {figure(line.frequency, 'Hz')} in the "
            "position is modelled as line noise of the sensor, also in filters."
            for line in self.lines
        ]
        notes += [f"{remark[0].upper()}{remark[1:]}." for remark in (*self.touched, *self.remarks)]
        notes += self._far_from_the_prior()
        if not self.converged:
            notes.append(
                "The search did not converge to a maximum: give a closer initial "
                "model or fewer free parameters."
            )
        return notes

    def _far_from_the_prior(self) -> Iterator[str]:
        """Yield values that are implausible for the described machine."""
        hint = "is the record of this machine, and neither cut off nor late?"
        for p in self.parameters:
            low, high = self.interval(p.name)
            if p.name == "delay" and high < 0:
                yield f"The delay is negative, the position answers before the control: {hint}"
            start = p.of(self.start)
            if p.name in DESCRIBED and (low > FAR * start or high < start / FAR):
                name = p.name.replace("_", " ")
                yield f"The {name} is {self[p.name] / start:.2g} times the initial one: {hint}"

    @property
    def series(self) -> dict[str, Any]:
        return {
            "parameters": {
                p.name: {
                    "unit": p.unit,
                    "interval_by": "profile" if p.name in self.profiles else "standard error",
                }
                for p in self.parameters
            },
            "correlation": self.correlation.tolist(),
            "held": dict(self.held),
            "log_likelihood": self.log_likelihood,
            "start_log_likelihood": self.start_log_likelihood,
            "samples": self.samples,
            "begun_from": self.started_from,
            "steps": self.steps,
            "converged": self.converged,
            "known_beforehand": {
                name: {"value": value, "standard_deviation": std}
                for name, (value, std) in self.model.known.items()
            },
            "touched": list(self.touched),
            "remarks": list(self.remarks),
            "current": None if self.current is None else self.current.to_dict(),
            "lines": [
                {"frequency": h.frequency, "amplitude": h.amplitude, "bandwidth": h.bandwidth}
                for h in self.lines
            ],
        }

    def figures(self) -> list[Figure]:
        return [estimates_figure(self), correlation_figure(self)]

    def _place(self, name: str) -> int:
        for at, parameter in enumerate(self.parameters):
            if parameter.name == name:
                return at
        why = self.held.get(name, "it was not looked for")
        raise AmbkitError(f"{name} is not identifiable: {why}")
