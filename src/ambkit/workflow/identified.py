"""Result of an identification: parameters, filter, validation."""

from __future__ import annotations

import math
import os
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path
from typing import Any

from ambkit.base import files
from ambkit.base.errors import AmbkitError
from ambkit.base.quantity_arguments import all_of_type
from ambkit.base.units import engineering
from ambkit.data.input_scaling import Inputs
from ambkit.data.record import Record
from ambkit.estimate.estimator import Estimator
from ambkit.estimate.filter_saving import made_by
from ambkit.estimate.kalman import ExtendedKalmanFilter
from ambkit.estimate.noise_model import FilterNoise
from ambkit.identification.forces.force_map import ForceMap, force_map
from ambkit.identification.maximum_likelihood import figures as plots
from ambkit.identification.maximum_likelihood.axis_model import AxisModel
from ambkit.identification.maximum_likelihood.baselines import AHEAD, errors_from_the_past
from ambkit.identification.maximum_likelihood.load_steps import cut_at_load_steps, names_of_parts
from ambkit.identification.maximum_likelihood.parameters import OFFSETS
from ambkit.identification.maximum_likelihood.result import MaximumLikelihood
from ambkit.identification.maximum_likelihood.structure import Structure
from ambkit.identification.maximum_likelihood.validation import Validation, validate
from ambkit.identification.noise import Noise, StandstillNoise
from ambkit.judge.adequacy import judge_adequacy, sentences
from ambkit.judge.adequacy_criteria import Finding
from ambkit.judge.load_following import FOLLOWING, least_process_noise
from ambkit.machine.machine import Machine
from ambkit.machine.stiffness import operating_points
from ambkit.result.report import Figure
from ambkit.result.result import Result
from ambkit.result.row import Row, Section, put
from ambkit.workflow.identified_toml import annotated_toml, carried_over
from ambkit.workflow.tuning import in_units

RAISED = made_by("identify", FOLLOWING)


@dataclass(frozen=True, eq=False, repr=False)
class Identified(Result):
    """A machine identified from closed-loop records, with uncertainty and validation."""

    prior: Machine  #: Prior of the axis, without the noise of `rest`.
    records: Sequence[Record]  #: Records used for identification.
    parts: Sequence[Record]  #: The same, cut where the disturbance force steps.
    likelihood: MaximumLikelihood  #: Maximum likelihood fit.
    #: Validation on each of the other records, or on `records` if there are none.
    validation: Sequence[Validation]
    on_others: bool  #: Whether validation used other records.
    #: (Noise or str) Noise at standstill by signal, or why it cannot be determined; empty without
    #: such a record.
    rest: StandstillNoise
    #: Test for structural errors of the model.
    structure: Structure = field(default_factory=Structure)
    forces: ForceMap | None = None  #: Force at the nodes of a grid, if requested.
    inputs: Inputs | None = None  #: Inputs of the controller, as the log has them.
    source: str = ""  #: File names of the records.

    def validate(self, *records: Record) -> Identified:
        """Return the identified machine, validated on other records."""
        others = all_of_type(Record, records=list(records))
        check_disjoint(others, self.records)
        others = [self.likelihood.model.record(record) for record in others]
        checks = validations(
            self.likelihood, self.records, self.parts, others, suspect=self.structure.suspect
        )
        return replace(self, validation=checks, on_others=True)

    @cached_property
    def filter(self) -> Estimator:
        """The extended filter of the identified model, with the offsets of the log."""
        return identified_filter(self, self.inputs, self.source)

    @cached_property
    def adequacy(self) -> list[Finding]:
        """Whether the filter is adequate."""
        return judge_adequacy(self.filter)

    def save_toml(self, path: str | os.PathLike[str]) -> None:
        text = annotated_toml(self.likelihood, Path(path).parent, self.machine)
        files.write_text(path, text)

    def save_product(self, what: str, path: Path, beside: Mapping[str, Path]) -> None:
        """Write the filter, or the part of the force map that the records determine."""
        if what == "filter":
            self.filter.save(path, machine=beside.get(".toml"))
        else:
            self._mapped.save(path)

    @cached_property
    def _mapped(self) -> ForceMap:
        if self.forces is not None:
            return self.forces
        check_mappable(self.machine)
        result = self.likelihood
        return force_map(result.model, self.parts, settling=result.settling)

    @property
    def isolated(self) -> Machine:
        """The isolated axis with the identified values."""
        return self.likelihood.isolated

    @property
    def machine(self) -> Machine:
        """The machine with the identified axis."""
        return self.likelihood.model.with_isolated(self.isolated)

    @property
    def of_the_zeros(self) -> list[str]:
        """Remarks on identified offsets, before a filter uses them."""
        result = self.likelihood
        looked_for = [p for p in result.parameters if p.name in OFFSETS]
        zeros = " and ".join(
            f"{p.name.replace('_', ' ')} {engineering(result[p.name], p.unit, 3)} "
            f"± {result.error_text(p)}"
            for p in looked_for
        )
        if not result.offsets_count:
            return [f"{zeros}: consistent with zero; the offsets are unchanged"]
        position = [p.name for p in looked_for if p.name == "position_offset"]
        noise = math.sqrt(result.isolated.sensor.noise_variance)
        if position and result.standard_error(position[0]) > noise:
            return [
                f"{zeros}: larger than the sensor's noise of {engineering(noise, 'm', 3)}, so the "
                "position is uncertain; if you have measured the offsets, omit them from free"
            ]
        return []

    @property
    def stiffness(self) -> dict[str, Any]:
        """Stiffnesses at the mean of the records, where they are most accurate."""
        iu, x = self.likelihood.model.mean_point(self.records)
        at = self.likelihood.stiffness(iu, x)
        return {"current": iu, "displacement": x} | {
            name: {"value": v, "standard_error": e} for name, (v, e) in at.items()
        }

    @cached_property
    def operating_points(self) -> dict[str, Any]:
        """Stiffnesses at the paper's 25 operating points, rows over the displacement."""
        current, displacement = operating_points(self.isolated)
        return {"current": current.tolist(), "displacement": displacement.tolist()} | {
            name: {"value": values.tolist(), "standard_error": errors.tolist()}
            for name, (values, errors) in self.likelihood.stiffness_map(
                current, displacement
            ).items()
        }

    TITLE = "Identification of {0.prior.name}"

    @property
    def finding(self) -> str:
        on = "" if self.on_others else " Not validated on other records."
        suspect = self.structure.suspect
        wrong = f" The structure of its model is suspect: {suspect}." if suspect else ""
        return f"{self.likelihood.finding}{wrong}{on}"

    @cached_property
    def rows(self) -> list[Row]:
        result, stiffness = [*self.likelihood.rows], self.stiffness
        for name, unit in (("k_i", "N/A"), ("k_s", "N/m")):
            at = stiffness[name]
            result.append(
                Row("value", "identified", at["value"], unit, error=at["standard_error"], of=name,
                    section=("stiffness",))
            )  # fmt: skip
        for name, noise in self.rest.items():
            if not isinstance(noise, str):
                result += put([
                    Row("standard_deviation", "noise, rms", noise.standard_deviation, noise.unit),
                    Row("colour", "colour", noise.colour),
                ], section=("rest",), of=name)  # fmt: skip
        result += [*self.structure.rows(), *self._at_operating_points()]
        for check in self.validation:
            result += put(check.rows(), section=("fits",), of=check.name)
        return result

    def _at_operating_points(self) -> Iterator[Row]:
        """Yield the stiffnesses at the paper's operating points, one column per current."""
        for name, unit in (("k_i", "N/A"), ("k_s", "N/m")):
            at = self.operating_points[name]
            for j, x in enumerate(self.operating_points["displacement"]):
                for k, iu in enumerate(self.operating_points["current"]):
                    label = engineering(x, "m", 3)
                    yield Row(
                        label, label, at["value"][j][k], unit, error=at["standard_error"][j][k],
                        of=engineering(iu, "A", 3), section=(name,), detail=True,
                    )  # fmt: skip

    @property
    def sections(self) -> dict[tuple[str, ...], Section]:
        at = self.stiffness
        where = f"{engineering(at['current'], 'A', 2)}, {engineering(at['displacement'], 'm', 2)}"
        return self.likelihood.sections | {
            ("stiffness",): Section(f"Stiffness at {where}", across=True),
            ("k_i",): Section("k_i at operating points, by the identified law"),
            ("k_s",): Section("k_s at operating points, by the identified law"),
            ("rest",): Section("At rest", across=True),
            ("structure",): Section("Structure of the model"),
            ("fits",): Section("Validation"),
        }

    @property
    def notes(self) -> list[str]:
        where = "" if self.on_others else ", the identification record"
        notes = [*self.structure.notes, *self.likelihood.notes]
        begins = {record.t[0] for record in self.records}
        if steps := [part.t[0] for part in self.parts if part.t[0] not in begins]:
            times = ", ".join(engineering(t, "s", 3) for t in steps)
            notes.insert(
                0, f"The disturbance force steps at {times}: its value after it is identified too."
            )
        notes += [f"{sentence}." for sentence in self.of_the_zeros]
        problems = {name: why for name, why in self.rest.items() if isinstance(why, str)}
        notes += [f"{name} at rest: {why}" for name, why in problems.items()]
        notes += [f"{check.name}{where}: {check.verdict}" for check in self.validation]
        if self.forces is not None:
            along, across = self.forces.force.shape
            notes.append(
                f"Force map: {across}x{along} nodes, of which the records determine "
                f"{int(self.forces.observed.sum())}: these are written. Their standard error is "
                f"below half of the assumed error of the law, "
                f"{engineering(self.forces.assumed, 'N', 3)}."
            )
        model = self.likelihood.model
        carried = carried_over(
            model, delay=not self.likelihood.delay_counts, offsets=self.likelihood.offsets_count
        )
        if any("[signals." in line for line in carried):
            notes.append("The machine file lists the necessary changes of the channel map.")
        noise = self.filter.variances.disturbance if self.machine.single else None
        if noise is not None and RAISED in self.filter.origin.values():
            notes.append(
                f"The filter's noise.disturbance is {in_units(noise)}: with the "
                f"{in_units(model.disturbance_noise)} of the records it would "
                "follow a disturbance force too slowly."
            )
        return [*notes, *sentences(self.adequacy)]

    @property
    def series(self) -> dict[str, Any]:
        result = self.likelihood
        data = dict(result.series) | {
            "machine": self.prior.name,
            "magnet_constant": result["magnet_constant"],
            "stiffness": {name: self.stiffness[name] for name in ("current", "displacement")},
            "operating_points": self.operating_points,
            "rest": {name: _noise_as_data(noise) for name, noise in self.rest.items()},
            "validated_on_other_records": self.on_others,
            "validation": [check.to_dict() for check in self.validation],
        }
        if self.forces is not None:
            data["force_map"] = {
                "nodes": self.forces.force.shape[::-1],
                "written": int(self.forces.observed.sum()),
                "assumed": self.forces.assumed,
            }
        return data

    def figures(self) -> list[Figure]:
        record, name = self.parts[0], self.validation[0].name
        model = self.likelihood.model
        return [
            plots.identified_figure(self.likelihood, self.validation),
            *self.likelihood.figures(),
            plots.fit_figure(self.validation),
            plots.prediction_figure(model, record, AHEAD[-1], name),
            plots.residual_figure(self.validation),
        ]


def check_disjoint(others: Sequence[Record], records: Sequence[Record]) -> None:
    """Reject a record that is used for both identification and validation."""
    if any(record is seen for record in others for seen in records):
        raise AmbkitError(
            "the same record is used for identification and validation: validate on another one"
        )


def validations(
    result: MaximumLikelihood, records: Sequence[Record], parts: Sequence[Record],
    others: Sequence[Record] = (), names: Sequence[str] | None = None, suspect: str = "",
) -> list[Validation]:  # fmt: skip
    """Validate an identified model on other records or its own, between force steps."""
    judged, pieces = (others, cut_at_load_steps(result, others)) if others else (records, parts)
    names = names or [f"record {number}" for number in range(1, len(judged) + 1)]
    model, checks = result.model, []
    for name, record in zip(names_of_parts(names, judged, pieces), pieces, strict=True):
        check = validate(model, record, start=result.start, settling=result.settling, name=name)
        errors = dict(check.errors)
        if not isinstance(model, AxisModel):
            settling = round(result.settling / record.sampling_time)
            errors |= errors_from_the_past(model, parts, record, settling)
        checks.append(replace(check, suspect=suspect, errors=errors))
    return checks


def _noise_as_data(noise: Noise | str) -> dict[str, Any]:
    if isinstance(noise, str):
        return {"problem": noise}
    names = ("variance", "standard_deviation", "unit", "samples", "colour", "correlation")
    return {name: getattr(noise, name) for name in names}


def identified_filter(
    result: Identified, inputs: Inputs | None = None, source: str = ""
) -> Estimator:
    """Return the extended filter of an identified model, with the offsets of the log."""
    model = result.likelihood.model
    made, raised = filter_following_load(result.machine, model.disturbance_noise)
    free = {p.name for p in result.likelihood.parameters}
    if not result.machine.single:
        made.origin = raised
        return made
    made.inputs = of_log = inputs or made.inputs
    if result.likelihood.offsets_count:
        volts = model.current_offset / result.isolated.amplifier.gain
        made.inputs = Inputs(y=of_log.y.shifted(-model.position_offset), u=of_log.u.shifted(volts))
    else:
        free -= set(OFFSETS)
    origin = made_by("identify", f"likelihood of {source or 'records'}")
    keys = {
        "measurement_noise": "noise.measurement", "control_noise": "noise.control",
        "disturbance_noise": "noise.disturbance", "position_offset": "inputs.y.offset",
        "current_offset": "inputs.u.offset",
    }  # fmt: skip
    made.origin = {key: origin for name, key in keys.items() if name in free} | raised
    return made


def filter_following_load(
    machine: Machine, intensity: float
) -> tuple[ExtendedKalmanFilter, dict[str, str]]:
    """Return a filter that follows the stated disturbance, and the origin of its process noise."""
    # With a constant load the likelihood cannot bound Q from below; a filter with a small Q would
    # follow no later load.

    def build(disturbance: float) -> ExtendedKalmanFilter:
        return ExtendedKalmanFilter(machine, noise=FilterNoise(disturbance=disturbance))

    least = least_process_noise(build, intensity)
    return build(least), {"noise.disturbance": RAISED} if least > intensity else {}


def check_mappable(machine: Machine) -> None:
    """Reject force maps of several axes."""
    if not machine.single:
        raise AmbkitError(f"forces are mapped of one axis, {machine.name} has several")
