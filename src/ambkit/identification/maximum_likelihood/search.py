"""The search: start, ascent, and parameters to be held."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ambkit.base.arrays import Array
from ambkit.base.errors import AmbkitError, ConfigError
from ambkit.base.units import engineering
from ambkit.data.record import Record
from ambkit.identification.dead_time import delayed, lagged
from ambkit.identification.maximum_likelihood.likelihood import STEP, Data, Likelihood, Local
from ambkit.identification.maximum_likelihood.loop_model import LoopModel
from ambkit.identification.maximum_likelihood.parameters import Coordinates, Parameter
from ambkit.identification.online.adaline import Adaline
from ambkit.machine.magnets import ConstantStiffness

CONVERGED = 1e-3
"""Newton's decrement that ends the search: squared distance to the maximum in standard errors."""

RIDGE = 0.5  #: Decrement that is accepted if no step ascends.

MUCH_LESS_LIKELY = 2.0
"""Loss of log likelihood from which a value counts as rejected (Edwards 1972)."""

LONGEST_STEP = 1.0  #: Maximum step in any coordinate of the search: an e-fold.
#: Loss of log likelihood that is exceeded by chance in one of 370 cases: three standard errors.
RULED_OUT = 4.5

LAGS = ("sensor_lag", "current_lag")
NO_LAG = 0.01  #: In samples: lag that counts as none.

NEAR_LIMIT, FAR_FROM_LIMIT = 3.0, 10.0
"""Distances from a limit, in deviations of the control noise: near, and far."""

MORE, LEAST_ROOM = 1.5, 20
"""Clearance over the range of a record; at least the second share of the described clearance."""

WALL = "its search ended at a bound"  #: Reason why a parameter is held.

MOST_DAMPING = 1e8

MOST_STEPS = 100

LEAST_GAIN = 0.1 * CONVERGED
"""Minimum gain of log likelihood of a step; a free one gains half of Newton's decrement."""


@dataclass(frozen=True, eq=False)
class Optimum:
    """End of a search."""

    likelihood: Likelihood  #: Its objective.
    z: Array  #: (p,) The most likely coordinates.
    value: float  #: Log likelihood of the maximum, extrapolated to second order.
    steps: int  #: Number of steps.
    converged: bool  #: Whether it reached a maximum.

    @cached_property
    def model(self) -> LoopModel:
        """The most likely model."""
        return self.likelihood.coordinates.model_at(self.z)

    @cached_property
    def local(self) -> Local:
        """Likelihood there."""
        return self.likelihood.local(self.z, rough=True)

    @property
    def samples(self) -> int:
        """Number of counted measurements."""
        return int(self.likelihood.innovations(self.z)[2].sum())


def maximise(
    data: Data, begin: LoopModel, parameters: list[Parameter], enough: float = CONVERGED
) -> Optimum:
    """Maximise by Fisher scoring with Marquardt's damping (1963)."""
    # It ends when Newton's decrement is below `enough`, or when a step gains what the parabola
    # predicted: the rest is of second order. SciPy's trust regions are balls in the coordinates;
    # here the accuracies differ by a factor of a thousand, and only a region in units of the errors
    # converges.
    likelihood = data.likelihood(begin, parameters)
    z, damping, steps = np.zeros(len(parameters)), 1e-3, 0
    at, rough = likelihood.local(z, rough=True), True
    while True:
        left = at.left
        value, converged = at.value + 0.5 * min(left, RIDGE), left < enough
        if converged or steps == MOST_STEPS:
            break
        step = _step_up(likelihood, z, at, damping)
        if step is None and rough:
            at, rough = likelihood.local(z), False
            continue
        if step is None:
            # At a whole number of samples the likelihood has a ridge over the delay: a maximum
            # there has a nonzero score.
            converged = left < RIDGE
            break
        z, damping, value = step
        steps, gain = steps + 1, value - at.value
        if abs(gain - 0.5 * left) < 0.1 * enough:
            converged = True
            break
        at, rough = likelihood.local(z, rough=True), True
        if gain < LEAST_GAIN:  # with an equal rest: it creeps along a limit
            value, converged = at.value + 0.5 * min(at.left, RIDGE), left < RIDGE
            break
    return Optimum(likelihood, z, value, steps, converged)


def _step_up(
    likelihood: Likelihood, z: Array, at: Local, damping: float
) -> tuple[Array, float, float] | None:
    """Return the end of an ascending step, the next damping, and the value, or None."""
    information = at.held
    while damping < MOST_DAMPING:
        damped = information + damping * np.diag(np.diag(information))
        step = np.asarray(np.linalg.solve(damped, at.score), float)
        step *= min(1.0, LONGEST_STEP / np.max(np.abs(step)))
        value = likelihood.value(z + step)
        if value > at.value:
            return z + step, max(damping / 10, 1e-9), value
        damping *= 10
    return None


def fix(
    data: Data,
    result: Optimum,
    parameter: Parameter,
    rest: list[Parameter],
    initial_model: LoopModel,
    first: LoopModel,
    *,
    strayed: bool,
) -> tuple[LoopModel, str]:
    """Return the model with a parameter at the user's value, and that value in words."""
    # The value from the search means little. But if the given value is far less likely, for any
    # other parameters, such as a noise that is nearly zero, the found value remains; a lag only if
    # the given one is rejected, as in `not_needed`. Not so for one that diverged, along a ridge or
    # to a limit: it is reset in any case, and the rest is also searched from `first`, where the
    # search began: the likelihood has another maximum, where noise explains all motion.
    value = parameter.of(initial_model)
    try:
        model = _with(result.model, parameter, value, rest)
    except ConfigError:  # the search ended where no rotor levitates with this value
        model, strayed = first.replace(**{parameter.place: value}), True
    if rest:
        begins = [model, *(first.replace(**{parameter.place: value}) for _ in range(strayed))]
        maximised = max(
            (maximise(data, begin, rest) for begin in begins), key=lambda one: one.value
        )
        loss = RULED_OUT if parameter.name in LAGS else MUCH_LESS_LIKELY
        likely = maximised.value > result.value - loss
        model = maximised.model if likely or strayed else result.model
    if model is result.model:
        why = f"because the initial {parameter.text(initial_model)} is far less likely"
        return model, f"{parameter.text(model)}, {why}"
    return model, parameter.text(model)


def unnecessary(
    data: Data, result: Optimum, parameters: Sequence[Parameter]
) -> tuple[Parameter, str] | None:
    """Return a lag without which the records are equally likely; None if there is none."""
    # Beside a delay a lag acts quadratically, so the records determine a negative value equally
    # well. If it is positive by chance, it is too long, with a misleadingly small error of its
    # logarithm. It is therefore accepted only if zero is rejected.
    for parameter in (p for p in parameters if p.name in LAGS):
        rest = [p for p in parameters if p is not parameter]
        if not rest:
            continue
        none = NO_LAG * result.model.isolated.sampling_time
        other = maximise(data, _with(result.model, parameter, none, rest), rest)
        if other.value > result.value - RULED_OUT:
            return parameter, "the records are about as likely without any"
    return None


def _with(
    model: LoopModel, parameter: Parameter, value: float, rest: Sequence[Parameter]
) -> LoopModel:
    """Return a model with another parameter value; the delay compensates for a lag."""
    # Their sum is unchanged, so no search of the delay has to cross the ridges at whole samples.
    others = {parameter.place: value}
    if parameter.name in LAGS and any(p.name == "delay" for p in rest):
        others["delay"] = model.delay + parameter.of(model) - value
    return model.replace(**others)


def diverged(result: LoopModel, parameters: Sequence[Parameter]) -> tuple[Parameter, str] | None:
    """Return a parameter that ended at a limit, with the limit; None if there is none."""
    # Beyond it there is no possible machine: a levitation current beyond the amplifier's.
    for parameter in parameters:
        try:
            for step in (-10 * STEP, 10 * STEP):
                Coordinates(result, [parameter]).model_at(np.array([step]))
        except ConfigError as error:
            return parameter, f"{WALL}: {error}"
    return None


def tighten_clearance(
    records: Sequence[Record], model: LoopModel, parameters: Sequence[Parameter]
) -> LoopModel:
    """Return a model with a clearance just beyond the range of the records."""
    # The clearance is less than the air gap. An inaccurate described clearance must not force the
    # gap to be larger.
    if not any(p.name == "air_gap" for p in parameters):
        return model
    b = model.isolated
    gone = max(float(np.nanmax(np.abs(record["y"]))) for record in records) / abs(b.sensor.gain)
    room = min(b.clearance, max(MORE * gone, b.clearance / LEAST_ROOM))
    return model.replace(rotor__clearance=room)


def restore_clearance(
    records: Sequence[Record], nominal_model: LoopModel, result: LoopModel
) -> tuple[LoopModel, list[str]]:
    """Return the result with the described stops, and the limits that it reached."""
    touched = []
    travel, gap = nominal_model.isolated.clearance, result.isolated.magnet.air_gap
    if gap <= travel:
        touched.append(
            f"the identified air gap, {engineering(gap, 'm', 4)}, is smaller than the described "
            f"clearance, {engineering(travel, 'm', 4)}; the clearance is set to "
            f"{engineering(result.isolated.clearance, 'm', 4)}, the range of the records"
        )
    else:
        result = result.replace(rotor__clearance=travel)
    near = [
        min(model.nearest_limit(record) for record in records) for model in (nominal_model, result)
    ]
    if near[0] > FAR_FROM_LIMIT and near[1] < NEAR_LIMIT:
        limit = engineering(result.isolated.current_max, "A", 3)
        touched.append(
            f"with the identified offset the control current reaches its limit of {limit}; with "
            "the initial one it does not"
        )
    return result, touched


LONGEST_DELAY = 8  #: Maximum candidate delay in samples.
GROWTHS = (1e-6, 1e-4, 1e-2, 1.0)  #: Candidate process noise intensities, over the given one.


def initial_guess(
    data: Data, initial_model: LoopModel, parameters: Sequence[Parameter]
) -> tuple[LoopModel, str]:
    """Return the most likely of several starts, and its name."""
    free = {p.name for p in parameters}
    candidates = [(initial_model, "the initial model")]
    if "magnet_constant" in free:
        candidates += [(model, "ADALINE") for model in _by_adaline(data.records, initial_model)]
    candidates += [
        (model, "least squares") for model in _by_least_squares(data.records, initial_model, free)
    ]
    if "delay" in free:
        T = initial_model.isolated.sampling_time
        candidates += [
            (model.replace(delay=(n + 0.5) * T), name)
            for model, name in candidates
            for n in range(LONGEST_DELAY)
        ]
    if "disturbance_noise" in free:
        process_noise = initial_model.disturbance_noise
        candidates += [
            (model.replace(disturbance_noise=process_noise * part), name)
            for model, name in candidates
            for part in GROWTHS[:-1]
        ]

    # A coarse likelihood suffices to compare starts.
    return max(candidates, key=lambda one: data.log_likelihood(one[0].replace(substeps=1)))


def _by_adaline(records: Sequence[Record], model: LoopModel) -> list[LoopModel]:
    """Return the model with ADALINE's magnet constant of the first record (paper, eq. 22-25)."""
    try:
        k = Adaline(model.undelayed_machine).run(model.corrected(records[0])).magnet_constant
        return [model.replace(magnet__magnet_constant=k)]
    except (AmbkitError, ValueError):
        return []


def _by_least_squares(
    records: Sequence[Record], model: LoopModel, free: set[str]
) -> list[LoopModel]:
    """Return k and s0 by least squares of smoothed accelerations: ``m a = k_i iu + k_s x + c``."""
    # Noise and closed loop bias it; it serves as a start. The gap follows from k_i/k_s, which at
    # the centre is s0/i0 for ideal iron, one-sided or two-sided, and nearly so for other magnets.
    from scipy.signal import savgol_filter

    b = model.isolated
    T, m = b.sampling_time, b.rotor.mass
    half = max(2, round(0.5 * math.sqrt(m / ConstantStiffness.of(b).k_s) / T))
    width = 2 * half + 1
    best: tuple[float, Array] | None = None
    for delay in range(LONGEST_DELAY + 1) if "delay" in free else (model.delay / T,):
        rows, targets = [], []
        for record in records:
            y, u = record["y"], delayed(lagged(record["u"], T, model.current_lag), delay)
            if y.size < 4 * width or not (np.isfinite(y).all() and np.isfinite(u).all()):
                continue
            # The same window for all three signals, which affects them equally.
            x = savgol_filter(y, width, 3) / b.sensor.gain
            a = savgol_filter(y, width, 3, deriv=2, delta=T) / b.sensor.gain
            iu = b.amplifier.gain * savgol_filter(u, width, 3)
            inside = slice(width, -width)
            rows.append(np.column_stack([iu, x, np.ones_like(x)])[inside])
            targets.append(m * a[inside])
        if not rows:
            return []
        A, f = np.concatenate(rows), np.concatenate(targets)
        size = np.linalg.norm(A, axis=0)
        if not np.all(size > 0):
            return []
        solution, *_ = np.linalg.lstsq(A / size, f, rcond=None)
        left = float(np.sum((f - A / size @ solution) ** 2))
        if best is None or left < best[0]:
            best = left, solution / size
    if best is None:
        return []
    k_i, k_s, _ = best[1].tolist()
    law, gap = ConstantStiffness.of(b), b.magnet.air_gap
    if "air_gap" in free and k_s > 0:
        gap *= (k_i / law.k_i) / (k_s / law.k_s)
    results = []
    for there in dict.fromkeys((gap, b.magnet.air_gap)):
        try:
            moved = model.replace(magnet__air_gap=there)
            if "magnet_constant" in free:
                k = b.magnet.magnet_constant * k_i / ConstantStiffness.of(moved.isolated).k_i
                moved = moved.replace(magnet__magnet_constant=k)
            if moved != model:
                results.append(moved)
        except AmbkitError:
            continue
    return results
