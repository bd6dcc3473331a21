"""A bearing from records of any loop, with its uncertainty, by maximum likelihood.

The prediction-error method with the core's Kalman filter: search by Fisher's scoring, errors and
correlations from the information, parameters that the records cannot tell apart named and held,
noises as the restricted likelihood has them.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from ambkit.base.errors import AmbkitError, RecordError
from ambkit.data.reading.despike import without_spikes
from ambkit.estimate.estimator import check_sampling
from ambkit.identification.maximum_likelihood.current_state import (
    TOO_QUIET,
    flowing,
    too_quiet,
)
from ambkit.identification.maximum_likelihood.information import doubtful
from ambkit.identification.maximum_likelihood.initial_guess import best_start
from ambkit.identification.maximum_likelihood.joint import Joint
from ambkit.identification.maximum_likelihood.likelihood import Likelihood, settling_time
from ambkit.identification.maximum_likelihood.line_noise import with_lines
from ambkit.identification.maximum_likelihood.loop_model import LoopModel, goes_on_a_line
from ambkit.identification.maximum_likelihood.parameters import (
    ALIKE,
    NOISES,
    USUAL,
    Coordinates,
    Parameter,
    beforehand,
    named,
    searchable,
)
from ambkit.identification.maximum_likelihood.profile_likelihood import intervals
from ambkit.identification.maximum_likelihood.restricted_likelihood import restricted
from ambkit.identification.maximum_likelihood.result import CONFIDENCE, MaximumLikelihood
from ambkit.identification.maximum_likelihood.search import (
    WALL,
    Climbed,
    climb,
    hold,
    narrowed,
    not_needed,
    ran_away,
    with_room,
)
from ambkit.identification.noise import position_step

if TYPE_CHECKING:
    from ambkit.data.record import Record
    from ambkit.machine.machine import Bearing


LEAST_SAMPLES = 100  #: That a record must have after the filter has settled.


def maximum_likelihood(
    records: Record | Sequence[Record],
    start: Bearing | LoopModel,
    free: Sequence[str] = USUAL,
    *,
    settling: float | None = None,
    improve_start: bool = True,
    profile: bool = True,
    lines: bool = False,
    use_control: bool = True,
    note: Callable[[str], object] = lambda _: None,
) -> MaximumLikelihood:
    """Find the parameters under which records are most likely."""
    # The noises among them are then corrected for what was fitted beside them (`restricted`).
    # Spikes of the position are left out first.
    logged = [records] if not isinstance(records, Sequence) else list(records)
    several, spikes = without_spikes(logged)
    initial_model = start if isinstance(start, LoopModel) else LoopModel(start)
    parameters, alike = searchable(named(free), initial_model)
    if not parameters:
        reasons = "".join(f"; {name}: {why}" for name, why in alike.items())
        raise AmbkitError(f"no parameter is free{reasons}")
    if settling is None:
        settling = settling_time(initial_model.bearing)
    _check_records(several, initial_model, settling)
    nominal_model, initial_model = initial_model, _movable(initial_model, parameters)
    current, measured, remarks = None, several, [spikes] if spikes else []
    if all(goes_on_a_line(record) for record in several):
        nominal_model, initial_model = (
            model.replace(line=True) for model in (nominal_model, initial_model)
        )
        current = flowing(several, initial_model.bearing.amplifier.gain) if use_control else None
    if current is not None:
        note("the current that flows, from control and measurement")
        several = list(current.records)
        nominal_model, initial_model = (
            current.driving(model) for model in (nominal_model, initial_model)
        )
    elif initial_model.line and too_quiet(several, settling_time(initial_model.bearing)):
        remarks.append(TOO_QUIET)
    known = beforehand(initial_model)
    names = {p.name for p in parameters}
    initial_model = initial_model.replace(
        known={name: known[name] for name in known if name in names}
    )
    initial_model = with_room(several, initial_model, parameters)
    begin, begun_from = initial_model, "the bearing given"
    if improve_start:
        note("looking for a start")
        begin, begun_from = best_start(several, initial_model, parameters, settling)
        # With a wrong idea of the noise, the information misleads; and offsets run away first.
        sure = [p for p in parameters if p.name in (*NOISES, "position_noise", "delay")]
        if 0 < len(sure) < len(parameters):
            begin = climb(several, begin, sure, settling).model
    held = {
        name: f"{why}; held at {named([name])[0].text(initial_model)}"
        for name, why in alike.items()
    }
    search = _Search(several, nominal_model, settling, note)
    result, free_parameters, missed = search.up(begin, parameters)
    if lines:
        note("looking for lines")
        hum = with_lines(several, result.model, free_parameters, settling, note).bearing.sensor.hum
        if hum != result.model.bearing.sensor.hum:
            # What could not be told beside lines that nobody knew of may be told now; and what
            # took their place is no start for it.
            begin = (begin if missed else result.model).replace(sensor__hum=hum)
            result, free_parameters, missed = search.up(begin, parameters)
    parameters, held = free_parameters, held | missed
    joint = None
    if current is not None:
        note("the coil, from current and position together")
        joint = Joint(
            measured, current, result.model, parameters, settling, current.coil.settled
        ).climbed()
        current, several = joint.current, list(joint.current.records)
        result = climb(several, joint.model, parameters, settling)
        remarks.append(current.text)
    note("correcting what is biased")
    model = restricted(several, result.model, result.local, parameters, settling)
    coordinates = Coordinates(model, parameters)
    local = Likelihood(several, coordinates, settling).local(np.zeros(len(parameters)))
    unit = np.outer(coordinates.unit_steps(), coordinates.unit_steps())
    joint_expansion = replace(joint, model=model).local(local) if joint is not None else local
    inverse = np.asarray(np.linalg.inv(joint_expansion.information), float)
    curved, robust = inverse * unit, inverse @ joint_expansion.scatter @ inverse * unit
    larger = np.sqrt(np.maximum(np.diag(robust) / np.diag(curved), 1.0))
    covariance = curved * np.outer(larger, larger)
    profiles: dict[str, tuple[float, float]] = {}
    if profile:
        note("looking how far the errors hold")
        uncoupled = np.asarray(
            np.linalg.inv(local.information), float
        )  # as if no coil were unknown
        larger *= np.sqrt(np.diag(inverse) / np.diag(uncoupled))
        profiles = intervals(several, model, parameters, uncoupled, larger, settling)
    if current is not None:
        searched, model = model, current.measuring(model)
        one = np.array([_relative(p, searched, model) for p in parameters])
        covariance, robust = (c * np.outer(one, one) for c in (covariance, robust))
        profiles.pop("control_noise", None)  # of what control and measurement leave unknown
    errors = np.sqrt(np.diag(covariance))
    delay = [k for k, p in enumerate(parameters) if p.name == "delay"]
    if delay and CONFIDENCE * errors[delay[0]] > initial_model.bearing.sampling_time:
        remarks.append("the loop is too quiet to tell the delay to a sample")
    model, touched = narrowed(several, nominal_model, model)
    return MaximumLikelihood(
        start=initial_model,
        model=model,
        parameters=parameters,
        values=np.array([p.of(model) for p in parameters]),
        errors=errors,
        robust_errors=np.sqrt(np.diag(robust)),
        covariance=covariance,
        correlation=covariance / np.outer(errors, errors),
        told=np.diag(inverse @ joint_expansion.told),
        profiles=profiles,
        touched=touched,
        remarks=remarks,
        current=current,
        held=held,
        log_likelihood=local.value,
        start_log_likelihood=Likelihood(several, Coordinates(initial_model, []), settling).value(
            np.zeros(0)
        ),
        samples=result.samples,
        begun_from=begun_from,
        steps=search.steps,
        converged=result.converged,
        settling=settling,
        position_step=position_step(logged),
    )


def _relative(p: Parameter, before: LoopModel, after: LoopModel) -> float:
    """By how much a standard error changes with the value that it is relative to."""
    return p.of(before) / p.of(after) if p.positive else 1.0


class _Search:
    """A search of records, in which what they do not tell is held."""

    def __init__(
        self,
        records: Sequence[Record],
        nominal_model: LoopModel,
        settling: float,
        note: Callable[[str], object],
    ) -> None:
        self.records, self.asked, self.settling, self.note = records, nominal_model, settling, note
        self.steps = 0

    def up(
        self, begin: LoopModel, parameters: list[Parameter]
    ) -> tuple[Climbed, list[Parameter], dict[str, str]]:
        """Go up, hold one parameter that is not told after the other, and go up again."""
        held: dict[str, str] = {}
        while True:
            self.note(f"searching {len(parameters)} parameters")
            result = climb(self.records, begin, parameters, self.settling)
            self.steps += result.steps
            worst = doubtful(result.local.information, parameters)
            worst = worst or ran_away(result.model, parameters)
            worst = worst or not_needed(self.records, result, parameters, self.settling)
            if worst is None:
                return result, parameters, held
            parameter, why = worst
            parameters = [p for p in parameters if p is not parameter]
            from_start = begin if ALIKE in why or WALL in why else None
            begin, at = hold(
                self.records, result, parameter, parameters, self.asked, self.settling, from_start
            )
            held[parameter.name] = f"{why}; held at {at}"
            if not parameters:
                raise AmbkitError(
                    "the records tell nothing: " + "; ".join(f"{n}: {w}" for n, w in held.items())
                )


def _check_records(records: Sequence[Record], model: LoopModel, settling: float) -> None:
    for record in records:
        check_sampling(model.bearing, record)
        least = round(settling / record.sampling_time) + LEAST_SAMPLES
        if len(record) < least:
            raise RecordError(
                f"a record has {len(record)} samples, {least} are needed to identify from: "
                f"{settling:.3g} s until the filter has settled, and {LEAST_SAMPLES}"
            )


def _movable(model: LoopModel, parameters: Sequence[Parameter]) -> LoopModel:
    """Return the model with a value above zero for each parameter whose logarithm is searched."""
    floors = {"current_lag": model.bearing.sampling_time, "disturbance_noise": 1e-12}
    zeros = {
        p.place: floors.get(p.name, 1e-12) for p in parameters if p.positive and not p.of(model) > 0
    }
    return model.replace(**zeros) if zeros else model
