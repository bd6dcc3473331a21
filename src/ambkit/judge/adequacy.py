"""Whether an estimator may fly on a machine: one judgement for all commands and exports."""

from __future__ import annotations

import hashlib
import math
import pickle
from collections.abc import Callable, Iterator, Mapping, Sequence
from functools import lru_cache
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from ambkit.base.errors import AmbkitError
from ambkit.base.threads import one_thread
from ambkit.base.units import engineering
from ambkit.estimate.adaptive_noise import AdaptiveNoise
from ambkit.estimate.base import Estimator
from ambkit.estimate.kalman import ExtendedKalmanFilter, KalmanFilter
from ambkit.estimate.low_pass import LowPass
from ambkit.estimate.noise import FilterNoise, Variances
from ambkit.estimate.one_axis import OneAxis
from ambkit.estimate.whole import Whole
from ambkit.judge.loop.margins import grid
from ambkit.machine.bank import alone_of, weights_of
from ambkit.machine.bearing import GRAVITY
from ambkit.machine.machine import Machine
from ambkit.machine.magnets import core_module, magnet_of, own_time
from ambkit.machine.rotors.whirl import end_of_range
from ambkit.simulation.control import Controller, needs_states
from ambkit.simulation.controllers import Control, controllers_of, pids_of
from ambkit.simulation.default_control import feedback_of, settled
from ambkit.simulation.flight import Flight
from ambkit.simulation.linear.closed import Loop
from ambkit.simulation.linear.control import compensator, controllers, fed
from ambkit.simulation.linear.control import controller as controller_of
from ambkit.simulation.linear.pieces import WorkPoint
from ambkit.simulation.linear.pieces import plant as linear_plant
from ambkit.simulation.linear.settled import estimator_at, settled_gain, tangents_known, tells
from ambkit.simulation.plant import Plant
from ambkit.simulation.scenario import PID, Scenario

if TYPE_CHECKING:
    from ambkit.machine.bearing import Bearing
    from ambkit.models.model import Array
    from ambkit.simulation.waveforms import Waveform

LOAD = 0.5
"""The stated load: so much of the load capacity, as a step of the disturbance force."""

FOLLOWED, LATE = 1.0, 3.0
"""In how many of the rotor's own time constants ``sqrt(m/k_s)`` the estimate is to follow that load
to 63 %: what is written, where the data does not say more, and what fails. Left to itself the rotor
departs by e in one of them, by 20 in three. With the first the peak of abs(S) is about that of zone
A, with the second beyond zone C."""

NIS = (0.25, 4.0)
"""Mean NIS between which innovations are within a factor of two of what the filter expects."""

ABSURD_NIS = 25.0
"""Mean NIS from which on, or below its inverse, filter and record have nothing in common."""

ZONES = (("C", 4.0), ("D", 5.0))
"""Peaks of abs(S) at which zones of ISO 14839-3 begin that are not for lasting operation."""

SAMPLED = (0.25, 0.5)
"""Sampling time over the rotor's own time constant: odd, and too slow to hold it."""

OTHER = 0.2
"""Relative difference from which on a number is of another machine, not of an identification."""

OTHER_MAGNET = 2.0
"""Factor in a stiffness that no operating point explains."""

FAR = 1e3
"""Factor in a noise intensity beyond what tuning may find."""

LIFTS = 1e3
"""Load capacity in weights from which on mass or magnet is doubtful."""


class Finding(NamedTuple):
    """One figure of the judgement."""

    name: str
    """What it is."""
    value: float
    """In `unit`."""
    unit: str
    limit: float
    """What it is held against, in the same unit."""
    sentence: str = ""
    """What is wrong; empty where nothing is."""
    fatal: bool = False
    """Whether the filter must not fly."""

    def to_dict(self) -> dict[str, Any]:
        """Return it as plain data, in SI."""
        return self._asdict()


def judge_adequacy(
    estimator: Any,
    plant: Bearing | Machine | None = None,
    happening: Scenario | Flight | None = None,
    nis: float = math.nan,
) -> list[Finding]:
    """Judge whether an estimator may fly."""
    own = getattr(estimator, "bearing", None)
    plant = own if plant is None else plant
    found = list(_innovations(nis))
    if isinstance(estimator, Estimator) and plant is not None:
        found += _static(estimator, plant, *_control_of(plant, happening))
    if plant is not None and happening is not None:
        found += _demands(plant, happening)
    return found


def sentences(found: Sequence[Finding]) -> list[str]:
    """Return what is wrong, the fatal first."""
    told = sorted((each for each in found if each.sentence), key=lambda each: not each.fatal)
    return list(dict.fromkeys(each.sentence for each in told))


def require_adequate(
    estimator: Estimator,
    plant: Bearing | Machine | None = None,
    happening: Scenario | Flight | None = None,
    *,
    force: bool,
) -> list[str]:
    """Refuse to export what must not fly; with `force` return why."""
    fatal = sentences([e for e in judge_adequacy(estimator, plant, happening) if e.fatal])
    if fatal and not force:
        raise AmbkitError(
            f"this filter must not fly: {'; '.join(fatal)}. --force, in Python force=True, exports "
            "it all the same"
        )
    return fatal


def load_capacity(plant: Bearing | Machine) -> list[float]:
    """Return the load [N] that each axis bears at x = 0, whichever way it pushes."""
    found = []
    for b, weight in zip(alone_of(plant), weights_of(plant), strict=True):
        law = magnet_of(b)
        ends = (b.current_min, b.current_max)
        found.append(min(abs(float(law.force(end, 0.0)) + weight) for end in ends))
    return found


def least_process_noise(make: Callable[[float], Estimator], found: float) -> float:
    """Return the process noise intensity [N^2/s] with which the stated load is followed."""
    first = make(found)
    plant = _plant_of(first)
    walks = (
        (LOAD * load) ** 2 / (FOLLOWED * own_time(b))
        for b, load in zip(alone_of(plant), load_capacity(plant), strict=True)
    )
    most = max(walks)

    def late(growth: float) -> bool:
        return any(each.time > FOLLOWED * each.own for each in _following(make(growth)))

    if found >= most or not late(found):
        return found
    low, high = math.log(max(found, 1e-12 * most)), math.log(most)
    while high - low > 0.05:
        middle = (low + high) / 2
        low, high = (middle, high) if late(math.exp(middle)) else (low, middle)
    return float(f"{math.exp(high):.3g}")


def _plant_of(estimator: Estimator) -> Any:
    return estimator.bearing


_JUDGED: dict[bytes, list[Finding]] = {}
_MOST_JUDGED = 1000


def _static(
    estimator: Estimator, plant: Bearing | Machine, control: Any, given: bool, fed_back: bool
) -> list[Finding]:
    """Return what follows from filter and machine alone; the same is judged once."""
    key = _key(estimator, plant, control, fed_back)
    if key not in _JUDGED:
        if len(_JUDGED) >= _MOST_JUDGED:
            _JUDGED.clear()
        found = [*_identity(estimator, plant), *_of_machine(plant)]
        if not any(each.name == "axes" for each in found):
            found += _noise(estimator, plant)
            with one_thread():
                found += _of_filter(estimator, plant, control, given, fed_back)
        _JUDGED[key] = found
    return _JUDGED[key]


def _key(estimator: Estimator, plant: Any, control: Any, fed_back: bool) -> bytes:
    held = estimator.magnet.in_core(core_module())
    each = held if isinstance(held, list) else [held]
    said = (
        type(estimator).__name__, estimator.name, str(dict(estimator.options)),
        str(dict(getattr(estimator, "inner", estimator).options)), estimator.variances,
        estimator.bearing.model_dump_json(), plant.model_dump_json(), fed_back,
        None if control is None else control.model_dump_json(),
        [pickle.dumps(getattr(one, "parameters", id(one))) for one in each],
    )  # fmt: skip
    return hashlib.sha256(pickle.dumps(said)).digest()


def _control_of(plant: Any, happening: Scenario | Flight | None) -> tuple[Any, bool, bool]:
    """Return the controller, whether it was given, and whether the estimate feeds it."""
    if isinstance(happening, Scenario):
        pid = happening.controller
        return pid, bool(pid.model_fields_set - {"feedback"}), pid.feedback == "estimate"
    if isinstance(happening, Flight):
        given = bool(happening.control.model_fields_set)
        return happening.control, given, feedback_of(plant, happening) == "estimate"
    return None, False, True


def _innovations(nis: float) -> Iterator[Finding]:
    if math.isnan(nis):
        return
    low, high = NIS
    limit, text = (high if nis > 1 else low), ""
    if not low <= nis <= high:
        text = (
            f"innovations are {math.sqrt(nis):.2g} times what the filter expects (mean NIS "
            f"{nis:.3g}, consistent from {low:g} to {high:g}); are the units, the signs and the "
            "bearing those of this record?"
        )
    yield Finding("mean NIS", nis, "1", limit, text, not 1 / ABSURD_NIS <= nis <= ABSURD_NIS)


def _numbers(b: Bearing) -> dict[str, tuple[float, str]]:
    """Return what tells one axis from another."""
    return {
        "sampling_time": (b.sampling_time, "s"),
        "rotor.mass": (b.rotor.mass, "kg"),
        "weight along x": (b.weight, "N"),
        "rotor.travel_limit": (b.rotor.travel_limit, "m"),
        "magnet.magnet_constant": (b.magnet.magnet_constant, "N m^2/A^2"),
        "magnet.air_gap": (b.magnet.air_gap, "m"),
        "magnet.bias_current": (b.magnet.bias_current, "A"),
        "amplifier.gain": (b.amplifier.gain, "A/V"),
        "sensor.gain": (b.sensor.gain, "1"),
    }


def _identity(estimator: Estimator, plant: Any) -> Iterator[Finding]:
    """Yield how far the filter's machine is from the one that it is to fly on."""
    own = _plant_of(estimator)
    if own == plant:
        yield Finding("greatest difference of a parameter", 0.0, "1", OTHER)
        return
    names = [
        ([a.name for a in of.axes], [r.name for r in of.readings])
        if isinstance(of, Machine)
        else None
        for of in (own, plant)
    ]
    who = f"the filter is of {own.name} (fingerprint {_print(own)}), not of {plant.name}"
    who = f"{who} (fingerprint {_print(plant)})"
    if names[0] != names[1]:
        yield Finding("axes", math.inf, "1", 0.0, f"{who}: axes or readings are others", True)
        return
    worst, told = 0.0, []
    for k, (one, other) in enumerate(zip(alone_of(own), alone_of(plant), strict=True)):
        axis = f" of {plant.axes[k].name}" if isinstance(plant, Machine) else ""
        ours, theirs = _numbers(one), _numbers(other)
        for name, (value, unit) in ours.items():
            true = theirs[name][0]
            off = abs(value - true) / max(abs(value), abs(true), 1e-300)
            worst = max(worst, off)
            if off > OTHER:
                said = [engineering(v, unit, digits=4) for v in (value, true)]
                told.append(f"{name}{axis} {said[0]}, not {said[1]}")
    text = f"{who}: {', '.join(told[:6])}" if told else ""
    yield Finding("greatest difference of a parameter", worst, "1", OTHER, text, bool(told))


def _print(plant: Any) -> str:
    return hashlib.sha256(plant.model_dump_json().encode()).hexdigest()[:6]


def _of_machine(plant: Bearing | Machine) -> Iterator[Finding]:
    """Yield what is absurd about the machine itself: sampled too slowly, or far too light."""
    T = plant.sampling_time
    fastest = min(alone_of(plant), key=own_time)
    share, tau = T / own_time(fastest), own_time(fastest)
    text = ""
    if share > SAMPLED[0]:
        text = (
            f"a sampling time of {engineering(T, 's', digits=3)} is {share:.3g} times the rotor's "
            f"own time constant sqrt(m/k_s), {engineering(tau, 's', digits=3)}, in which it falls "
            f"away by e; the limit is {SAMPLED[1]:g}: are sampling_time, mass and magnet right?"
        )
    name = "sampling time over own time constant"
    yield Finding(name, share, "1", SAMPLED[1], text, share > SAMPLED[1])
    lifts = [
        load / (b.rotor.mass * GRAVITY)
        for b, load in zip(alone_of(plant), load_capacity(plant), strict=True)
    ]
    most, text = max(lifts), ""
    if most > LIFTS:
        text = f"the magnet lifts {most:.3g} times the rotor's weight: is rotor.mass right?"
    yield Finding("load capacity over weight", most, "1", LIFTS, text)


def _usual(plant: Any) -> Variances:
    """Return the variances that a filter of a machine has by default."""
    view = Whole(plant) if isinstance(plant, Machine) else OneAxis(plant)
    return view.variances(FilterNoise())


def _noise(estimator: Estimator, plant: Bearing | Machine) -> Iterator[Finding]:
    """Yield how far the noise that a filter assumes is from what its machine has."""
    usual = _usual(plant)
    for name, unit, what, of in (
        ("measurement", "m^2", "measurement noise", "the sensor's"),
        ("disturbance", "N^2/s", "process noise intensity", "the usual (2 m g)^2/s"),
    ):
        ours, theirs = (np.atleast_1d(getattr(v, name)) for v in (estimator.variances, usual))
        with np.errstate(divide="ignore"):
            far = np.abs(np.log(ours / theirs))
        k = int(np.argmax(far))
        ratio, text = float(ours[k] / theirs[k]), ""
        if far[k] > math.log(FAR) + 1e-6:
            text = (
                f"noise.{name}, {engineering(float(ours[k]), unit, digits=3)}, is {ratio:.2g} "
                f"times {of}, {engineering(float(theirs[k]), unit, digits=3)}"
            )
        yield Finding(what, ratio, "1", FAR, text, bool(text) and name == "measurement")


def _of_filter(
    estimator: Estimator, plant: Bearing | Machine, control: Any, given: bool, fed_back: bool
) -> Iterator[Finding]:
    """Yield magnet, following and margins."""
    if estimator.options.get("gravity") == "disturbance" and any(weights_of(plant)):
        weight = max(map(abs, weights_of(plant)))
        text = (
            f"the weight, {engineering(weight, 'N', digits=3)}, is part of the estimated "
            'disturbance force (gravity = "disturbance")'
        )
        yield Finding("weight in the disturbance force", weight, "N", 0.0, text)
    stand_in = settling(estimator)
    try:
        yield from _magnet(estimator, plant)
        if not isinstance(estimator, LowPass):
            yield from _follows(stand_in, plant)
        if fed_back:
            yield from _margins(stand_in, plant, control, given)
    except AmbkitError as error:
        yield Finding("settled gain", math.nan, "1", math.nan, f"it cannot be judged: {error}")


def settling(estimator: Estimator) -> Estimator:
    """Return an estimator that settles to a gain: itself, its inner one, or the nearest kind."""
    if isinstance(estimator, AdaptiveNoise):
        return settling(estimator.inner)
    if tells(estimator):
        return estimator
    return ExtendedKalmanFilter(
        estimator.bearing, estimator.magnet, noise=FilterNoise(*estimator.variances),
        synchronous=estimator.options.get("synchronous", ()),
    )  # fmt: skip


@lru_cache(maxsize=64)
def _point(of: Any) -> WorkPoint:
    return WorkPoint.of_machine(of) if isinstance(of, Machine) else WorkPoint.hovering(of)


def _magnet(estimator: Estimator, plant: Any) -> Iterator[Finding]:
    """Yield how far what the filter knows of its magnet is from that of the machine."""
    if isinstance(estimator, LowPass):
        return
    point = _point(plant)
    ours = np.atleast_2d(np.array(tangents_known(estimator.magnet, "tangent", point)).T)
    theirs = np.array([
        magnet_of(b).tangent(float(iu), float(x))
        for b, (iu, x) in zip(alone_of(plant), np.atleast_2d(np.array(point[:2]).T), strict=True)
    ])  # fmt: skip
    worst, text = 1.0, ""
    for name, unit, k in (("k_i", "N/A", 0), ("k_s", "N/m", 1)):
        for one, other in zip(ours[:, k].tolist(), theirs[:, k].tolist(), strict=True):
            factor = math.inf if one * other <= 0 else max(one / other, other / one)
            if abs(other) > 0 and factor > worst:
                worst = factor
                if factor > OTHER_MAGNET:
                    said = [engineering(v, unit, digits=3) for v in (one, other)]
                    text = f"the filter takes the magnet's {name} for {said[0]}, it is {said[1]}"
    yield Finding("factor in a stiffness", worst, "1", OTHER_MAGNET, text, bool(text))


class _Following(NamedTuple):
    """How an estimate follows a step of 1 N."""

    axis: int
    time: float  # to 63 % [s]
    own: float  # the rotor's own time constant [s]
    wrong: float  # the greatest error of the position [m/N]
    noise: float  # of the estimated force by the sensors' noise [N]


def _following(estimator: Estimator) -> list[_Following]:
    """Return how an estimate follows a step of each disturbance force, by its model and gain."""
    # The error of the state goes by ``e+ = A (I - K H) e`` from the step on, whatever the control.
    plant = _plant_of(estimator)
    point, alone = _point(plant), alone_of(plant)
    model = estimator.linear_model(*tangents_known(estimator.magnet, "tangent", point))
    kept: Any = np.arange(len(estimator.states))
    if isinstance(getattr(estimator, "gain", None), np.ndarray):
        K: Array = estimator.gain[:, None]  # type: ignore[attr-defined]
    else:
        K, kept = settled_gain(estimator, point)
    A, H = model.A[np.ix_(kept, kept)], model.H[:, kept]
    roles = [estimator.states[k].role for k in kept]
    loads = [k for k, role in enumerate(roles) if role == "disturbance force"]
    owns = [own_time(b) for b in alone]
    if len(loads) < len(alone):  # a load that does not wander is never followed
        return [_Following(k, math.inf, own, math.inf, 0.0) for k, own in enumerate(owns)]
    whole = estimator.whole
    if whole is None:
        rows = np.eye(len(kept))[[roles.index("position")]]
    else:
        rows = whole.along_axes(estimator.states)[0][:, kept]
    M, T = A @ (np.eye(len(kept)) - K @ H), estimator.model.T
    n, p = max(8, math.ceil(4 * LATE * max(owns) / T)), len(loads)
    noisy = A @ K * np.sqrt(np.atleast_1d(model.R))
    e = np.hstack([np.eye(len(kept))[:, loads], noisy])
    left, wrong, square = np.empty((n, p)), np.zeros(p), np.zeros(p)
    for k in range(n):
        square += (e[loads, p:] ** 2).sum(axis=1)
        e = M @ e
        left[k] = np.abs(e[loads, range(p)])
        wrong = np.maximum(wrong, np.abs(rows @ e[:, :p]).max(axis=0))
    found = []
    for k, own in enumerate(owns):
        beyond = np.flatnonzero(~(left[:, k] <= math.exp(-1)))
        time = T * (beyond[-1] + 2) if beyond.size else T
        time = math.inf if beyond.size and beyond[-1] == n - 1 else float(time)
        found.append(_Following(k, time, own, float(wrong[k]), float(np.sqrt(square[k]))))
    return found


def _follows(estimator: Estimator, plant: Any) -> Iterator[Finding]:
    """Yield how a step of the stated load is followed, and what noise its estimate has."""
    loads = load_capacity(plant)
    each = _following(estimator)
    slow = max(each, key=lambda one: one.time / one.own)
    step, limit, text = LOAD * loads[slow.axis], LATE * slow.own, ""
    if slow.time > limit:
        took = "more than " * math.isinf(slow.time) + engineering(
            min(slow.time, 4 * limit), "s", digits=3
        )
        text = (
            f"a disturbance force of {engineering(step, 'N', digits=3)}, {LOAD:.0%} of the load "
            f"capacity, is followed to 63 % in {took}; the limit is "
            f"{engineering(limit, 's', digits=3)}, {LATE:g} times the rotor's own time constant "
            f"sqrt(m/k_s). Meanwhile its position is wrong by up to "
            f"{engineering(step * slow.wrong, 'm', digits=3)}: raise noise.disturbance"
        )
    yield Finding("time to follow a load", slow.time, "s", limit, text, bool(text))
    sensors = np.sqrt(np.max(
        np.atleast_1d(_usual(plant).measurement)
        / np.atleast_1d(estimator.variances.measurement)
    ))  # fmt: skip
    loud = max(each, key=lambda one: one.noise / loads[one.axis])
    rms, most, text = float(loud.noise * sensors), loads[loud.axis], ""
    if rms > LOAD * most:
        text = (
            f"the sensor's noise alone moves the estimated force by "
            f"{engineering(rms, 'N', digits=3)} rms, of a load capacity of "
            f"{engineering(most, 'N', digits=3)}: lower noise.disturbance"
        )
    yield Finding("noise of the estimated force", rms, "N", most, text, rms > most)


def _margins(estimator: Estimator, plant: Any, control: Any, given: bool) -> Iterator[Finding]:
    """Yield the peak of abs(S) of the loop whose controllers the estimate feeds."""
    peak = loop_peak(plant, estimator, control)
    text, fatal, limit = "", False, ZONES[1][1]
    zone = next((name for name, begins in reversed(ZONES) if peak >= begins), "")
    if zone:
        whose = "this controller" if given else "the default controller"
        text = (
            f"with {whose} the loop is unstable"
            if math.isinf(peak)
            else f"with {whose} the peak of |S| is {peak:.3g}, zone {zone} of ISO 14839-3"
        )
        fatal = peak >= limit
        if fatal and not given and loop_peak(plant, KalmanFilter(plant)) >= limit:
            fatal, text = False, f"{text}; with the default filter too: the controller is at fault"
    yield Finding("peak of |S|", peak, "1", limit, text, fatal)


def loop_peak(plant: Any, estimator: Estimator, control: Any = None) -> float:
    """Return the peak of abs(S) [1] on a coarse grid, infinite where the loop is unstable."""
    loop = _loop(plant, estimator, control, _point(plant))
    if not loop.is_stable:
        return math.inf
    f = grid(loop, 60, 5)
    top = end_of_range(plant.sampling_time, plant.speed)
    along = loop.along_axes(np.append(f[f < top], top))
    return float(np.abs(np.diagonal(along, axis1=1, axis2=2)).max())


def _loop(plant: Any, estimator: Estimator, control: Any, point: WorkPoint) -> Loop:
    """Return the loop of a machine at a work point with controllers that an estimator feeds."""
    P = linear_plant(plant, point)
    summing: tuple[Any, Any] = (None, None)
    if isinstance(plant, Machine):
        control = settled(plant, control or Control(), "estimate")
        pids = pids_of(plant, control, "estimate") if control.type == "decentralised" else None
        flown = controllers_of(Plant(plant), control, estimator, pids)
        whole, m = Whole(plant), len(plant.readings)
        shown = whole.H @ whole.shown
        summing = (shown, np.asarray(np.linalg.pinv(shown), float))
    else:
        pid = (control or PID()).completed(plant).model_copy(update={"feedback": "estimate"})
        shown, m = np.array([[1 / plant.sensor.gain]]), 1
        if not needs_states(pid):
            inner = estimator_at(estimator, point)
            return Loop(P, compensator(controller_of(pid, plant), inner, shown, P.outputs[:1]), 1)
        flown = Controller(plant, estimator, pid).law
    rows = fed(flown, len(estimator.states), plant.speed or 0.0)
    control = controllers(flown, plant, measured=False)
    inner = estimator_at(estimator, point, (rows, control.inputs[: len(rows)]))
    return Loop(P, compensator(control, inner, flown.of_axes @ shown, P.outputs[:m]), m, *summing)


def _demands(plant: Any, happening: Scenario | Flight) -> Iterator[Finding]:
    """Yield travel and force that a run asks for against what there is."""
    for axis, b, load in zip(_axes(plant), alone_of(plant), load_capacity(plant), strict=True):
        position, force = _asked_of(happening, axis)
        where = f" of {axis}" if axis else ""
        for what, each, most, unit in (
            ("reference", position, b.rotor.travel_limit, "m"),
            ("disturbance force", force, load, "N"),
        ):
            far = _greatest(each, happening.duration)
            text = ""
            if far > most:
                limit = "clearance" if unit == "m" else "load capacity"
                text = (
                    f"the {what}{where} reaches {engineering(far, unit, digits=3)}, beyond the "
                    f"{limit} of {engineering(most, unit, digits=3)}"
                )
            yield Finding(f"{what}{where}", far, unit, most, text)


def _axes(plant: Any) -> list[str]:
    return [axis.name for axis in plant.axes] if isinstance(plant, Machine) else [""]


def _asked_of(happening: Scenario | Flight, axis: str) -> tuple[list[Any], list[Any]]:
    if isinstance(happening, Scenario):
        return [happening.reference], [happening.disturbance]
    return (
        [each.position for each in happening.reference if each.axis == axis],
        [each.force for each in happening.disturbance if each.axis == axis],
    )


def _greatest(signals: Sequence[Waveform], duration: float) -> float:
    """Return the greatest magnitude of a sum of signals over a run."""
    if not signals:
        return 0.0
    t = np.linspace(0.0, duration, 2001)
    return float(np.abs(sum(each.sample(t) for each in signals)).max())


def as_rows(found: Sequence[Finding]) -> list[Mapping[str, Any]]:
    """Return the findings as plain data, in SI."""
    return [each.to_dict() for each in found]
