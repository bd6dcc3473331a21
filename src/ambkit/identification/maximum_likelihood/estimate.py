"""Maximum likelihood identification from closed-loop records, with uncertainty.

Prediction-error method with the core's Kalman filter: Fisher scoring, errors and correlations from
the information, parameters that the records cannot distinguish reported and held, noise by
restricted likelihood.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from ambkit.base.errors import AmbkitError, RecordError
from ambkit.data.reading.faults import without_spikes
from ambkit.data.record import Record
from ambkit.estimate.along_records import check_sampling
from ambkit.identification.maximum_likelihood import search as ascent
from ambkit.identification.maximum_likelihood.current_state import (
    INSUFFICIENT_EXCITATION,
    CurrentState,
    insufficient_excitation,
    is_interpolated,
    smooth_current,
)
from ambkit.identification.maximum_likelihood.information import (
    intervals,
    restricted,
    weakly_identified,
)
from ambkit.identification.maximum_likelihood.joint import Joint
from ambkit.identification.maximum_likelihood.likelihood import Data, Local
from ambkit.identification.maximum_likelihood.line_noise import with_lines
from ambkit.identification.maximum_likelihood.loop_model import LoopModel
from ambkit.identification.maximum_likelihood.parameters import (
    ALIKE,
    NOISES,
    USUAL,
    Coordinates,
    Parameter,
    identifiable,
    named,
    priors_of,
    uncertain,
)
from ambkit.identification.maximum_likelihood.result import CONFIDENCE, MaximumLikelihood
from ambkit.identification.noise import position_step
from ambkit.machine.accessories import Hum
from ambkit.machine.machine import Machine
from ambkit.machine.magnets import own_time

LEAST_SAMPLES = 100  #: Minimum number of samples of a record after the filter has settled.
STILL = 1e-9  #: Share of the clearance below which a position does not move.


def maximum_likelihood(
    records: Record | Sequence[Record],
    start: Machine | LoopModel,
    free: Sequence[str] = USUAL,
    *,
    settling: float | None = None,
    improve_start: bool = True,
    profile: bool = True,
    lines: bool = False,
    use_control: bool = True,
    note: Callable[[str], object] = lambda _: None,
) -> MaximumLikelihood:
    """Return the parameters of maximum likelihood."""
    # Its noise parameters are then corrected for the other fitted parameters (`restricted`). Spikes
    # of the position are rejected first.
    logged = [records] if not isinstance(records, Sequence) else list(records)
    several, spikes = without_spikes(logged)
    model = start if isinstance(start, LoopModel) else LoopModel(start)
    parameters, alike = identifiable(named(free), model)
    if not parameters:
        reasons = "".join(f"; {name}: {why}" for name, why in alike.items())
        raise AmbkitError(f"no parameter is free{reasons}")
    data = Data(several, own_time(model.isolated) if settling is None else settling)
    _check_records(data, model)
    search = _Search(data, model, note)
    search.remarks += [*([spikes] if spikes else []), *model.taken_as_known]
    search.prepare(parameters, use_control=use_control)
    begin, started_from = search.begin(parameters, improve_start=improve_start)
    held = {
        name: f"{why}; held at {named([name])[0].text(search.initial)}"
        for name, why in alike.items()
    }
    result, free_parameters, missed = search.up(begin, parameters)
    if lines:
        hum = search.lines(result.model, free_parameters)
        if hum != result.model.isolated.sensor.hum:
            # Parameters that were not identifiable with unmodelled lines may be now; and values
            # that compensated for them are bad starts.
            begin = (begin if missed else result.model).replace(sensor__hum=hum)
            result, free_parameters, missed = search.up(begin, parameters)
    parameters = free_parameters
    joint = search.joint(result.model, parameters)
    if joint is not None:
        result = ascent.maximise(search.data, joint.model, parameters)
    note("correcting what is biased")
    model = restricted(search.data, result.model, result.local, parameters)
    model, errors = search.errors(model, parameters, joint, missed, profile=profile)
    step = position_step(logged)
    return search.result(model, parameters, errors, result, held | missed, started_from, step)


class _Search:
    """A search in which unidentifiable parameters are held."""

    def __init__(self, data: Data, nominal: LoopModel, note: Callable[[str], object]) -> None:
        self.measured, self.data, self.note = data.records, data, note
        self.nominal = self.initial = nominal
        self.current: CurrentState | None = None
        self.remarks: list[str] = []
        self.steps = 0

    def prepare(self, parameters: list[Parameter], *, use_control: bool) -> None:
        """Smooth the current, and set up priors and search space."""
        models = [self.nominal, _movable(self.nominal, parameters)]
        if all(is_interpolated(record) for record in self.measured):
            models = [model.replace(line=True) for model in models]
            gain = models[1].isolated.amplifier.gain
            self.current = smooth_current(self.measured, gain) if use_control else None
        if self.current is not None:
            self.note("the current that flows, from control and measurement")
            self.data = replace(self.data, records=self.current.records)
            models = [self.current.driving(model) for model in models]
        elif models[1].line and insufficient_excitation(
            self.measured, own_time(models[1].isolated)
        ):
            self.remarks.append(INSUFFICIENT_EXCITATION)
        self.nominal, initial = models
        known = priors_of(initial, [p.name for p in parameters])
        self.initial = ascent.tighten_clearance(
            self.data.records, initial.replace(known=known), parameters
        )

    def begin(self, parameters: list[Parameter], *, improve_start: bool) -> tuple[LoopModel, str]:
        """Return the start of the search, and its name."""
        if not improve_start:
            return self.initial, "the initial model"
        self.note("looking for a start")
        begin, started_from = ascent.initial_guess(self.data, self.initial, parameters)
        # With a wrong noise model the information misleads, and offsets diverge first.
        sure = [p for p in parameters if p.name in (*NOISES, "position_noise", "delay")]
        if 0 < len(sure) < len(parameters):
            begin = ascent.maximise(self.data, begin, sure).model
        return begin, started_from

    def up(
        self, begin: LoopModel, parameters: list[Parameter]
    ) -> tuple[ascent.Optimum, list[Parameter], dict[str, str]]:
        """Maximise, hold unidentifiable parameters one by one, and maximise again."""
        held: dict[str, str] = {}
        first = begin
        while True:
            self.note(f"searching {len(parameters)} parameters")
            result = ascent.maximise(self.data, begin, parameters)
            self.steps += result.steps
            information = self.beside(held, result.model, parameters).information
            worst = weakly_identified(information, parameters, self.initial)
            worst = worst or ascent.diverged(result.model, parameters)
            worst = worst or ascent.unnecessary(self.data, result, parameters)
            if worst is None:
                return result, parameters, held
            parameter, why = worst
            parameters = [p for p in parameters if p is not parameter]
            strayed = ALIKE in why or ascent.WALL in why
            begin, at = ascent.fix(
                self.data, result, parameter, parameters, self.nominal, first, strayed=strayed
            )
            first = first.replace(**{parameter.place: parameter.of(begin)})
            held[parameter.name] = f"{why}; held at {at}"
            if not parameters:
                raise AmbkitError(
                    "the records determine no parameter: "
                    + "; ".join(f"{n}: {w}" for n, w in held.items())
                )

    def beside(
        self, held: Iterable[str], model: LoopModel, parameters: list[Parameter],
        joint: Joint | None = None,
    ) -> Local:  # fmt: skip
        """Return the likelihood at a model, with coarse priors of the parameters that are held."""
        rest = uncertain(named(tuple(held)))
        everything, p = [*parameters, *rest], len(parameters)
        local = self.data.local(model, everything)
        if joint is not None:
            local = replace(joint, model=model, parameters=everything).local(local)
        precision = {p + at: 1 / one.range(model) ** 2 for at, one in enumerate(rest)}
        return local.beside(range(p), precision)

    def lines(self, model: LoopModel, parameters: list[Parameter]) -> tuple[Hum, ...]:
        """Return the lines of a model's sensor, and those detected in the position."""
        self.note("looking for lines")
        return with_lines(self.data, model, parameters, self.note).isolated.sensor.hum

    def joint(self, model: LoopModel, parameters: list[Parameter]) -> Joint | None:
        """Maximise over coil and loop jointly, if there is a smoothed current."""
        if self.current is None:
            return None
        self.note("the coil, from current and position together")
        settled = self.current.coil.settled
        joint = Joint(
            self.measured, self.current, model, parameters, self.data.settling, settled
        ).maximised()
        self.current = joint.current
        self.data = replace(self.data, records=joint.current.records)
        self.remarks.append(joint.current.text)
        return joint

    def errors(
        self,
        model: LoopModel,
        parameters: list[Parameter],
        joint: Joint | None,
        held: Mapping[str, str],
        *,
        profile: bool,
    ) -> tuple[LoopModel, dict[str, Any]]:
        """Return a model for the signals as measured, and its errors."""
        expansion = self.beside(held, model, parameters, joint)
        steps = Coordinates(model, parameters).unit_steps()
        unit = np.outer(steps, steps)
        inverse = np.asarray(np.linalg.inv(expansion.information), float)
        curved, robust = inverse * unit, inverse @ expansion.scatter @ inverse * unit
        larger = np.sqrt(np.maximum(np.diag(robust) / np.diag(curved), 1.0))
        covariance = curved * np.outer(larger, larger)
        profiles: dict[str, tuple[float, float]] = {}
        if profile:
            self.note("computing profile likelihood intervals")
            # As if the coil, and what is held, were known.
            information = self.data.local(model, parameters).information
            uncoupled = np.asarray(np.linalg.inv(information), float)
            larger *= np.sqrt(np.diag(inverse) / np.diag(uncoupled))
            profiles = intervals(self.data, model, parameters, uncoupled, larger)
        if self.current is not None:
            searched, model = model, self.current.measuring(model)
            # A relative error changes with its reference value.
            one = np.array([p.of(searched) / p.of(model) if p.positive else 1.0
                            for p in parameters])  # fmt: skip
            covariance, robust = (c * np.outer(one, one) for c in (covariance, robust))
            profiles.pop("control_noise", None)  # what control and measurement leave uncertain
        errors = np.sqrt(np.diag(covariance))
        return model, {
            "errors": errors,
            "robust_errors": np.sqrt(np.diag(robust)),
            "covariance": covariance,
            "correlation": covariance / np.outer(errors, errors),
            "record_share": np.diag(inverse @ expansion.record_information),
            "profiles": profiles,
            "log_likelihood": expansion.value,
        }

    def result(
        self,
        model: LoopModel,
        parameters: list[Parameter],
        errors: dict[str, Any],
        optimum: ascent.Optimum,
        held: dict[str, str],
        started_from: str,
        step: float | None,
    ) -> MaximumLikelihood:
        """Return the result, with the stops of the description."""
        delay = [k for k, p in enumerate(parameters) if p.name == "delay"]
        if delay and CONFIDENCE * errors["errors"][delay[0]] > model.isolated.sampling_time:
            self.remarks.append(
                "the records have too little motion to determine the delay to a sample"
            )
        model, touched = ascent.restore_clearance(self.data.records, self.nominal, model)
        return MaximumLikelihood(
            start=self.initial,
            model=model,
            parameters=parameters,
            values=np.array([p.of(model) for p in parameters]),
            **errors,
            touched=touched,
            remarks=self.remarks,
            current=self.current,
            held=held,
            start_log_likelihood=self.data.log_likelihood(self.initial),
            samples=optimum.samples,
            started_from=started_from,
            steps=self.steps,
            converged=optimum.converged,
            settling=self.data.settling,
            position_step=step,
        )


def _check_records(data: Data, model: LoopModel) -> None:
    for record in data.records:
        check_sampling(model.isolated, record)
        least = round(data.settling / record.sampling_time) + LEAST_SAMPLES
        if len(record) < least:
            raise RecordError(
                f"a record has {len(record)} samples, {least} are needed to identify from: "
                f"{data.settling:.3g} s until the filter has settled, and {LEAST_SAMPLES}"
            )
        y = record["y"][np.isfinite(record["y"])] / model.isolated.sensor.gain
        if y.size and np.ptp(y) < STILL * model.isolated.clearance:
            raise RecordError("y stands still: nothing can be identified from it")


def _movable(model: LoopModel, parameters: Sequence[Parameter]) -> LoopModel:
    """Return the model with a positive value for each parameter whose logarithm is searched."""
    floors = {"current_lag": model.isolated.sampling_time, "disturbance_noise": 1e-12}
    zeros = {
        p.place: floors.get(p.name, 1e-12) for p in parameters if p.positive and not p.of(model) > 0
    }
    return model.replace(**zeros) if zeros else model
