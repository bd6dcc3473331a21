"""Criteria of a filter's adequacy for a machine."""

from __future__ import annotations

import hashlib
import math
from collections.abc import Iterator, Sequence
from contextlib import suppress
from typing import Any, NamedTuple

import numpy as np

from ambkit.base.errors import AmbkitError
from ambkit.base.units import engineering
from ambkit.control.control import Control
from ambkit.control.linear.steady_state_filter import tangents_known
from ambkit.estimate.estimator import Estimator
from ambkit.estimate.kalman import KalmanFilter
from ambkit.estimate.machine_model import View
from ambkit.estimate.noise_model import FilterNoise
from ambkit.judge.load_following import LONGEST, STEP, following, operating_point, settling
from ambkit.judge.loop.loop_builder import ZONES, LoopBuilder, zone_of
from ambkit.judge.loop.margins import axis_peaks
from ambkit.judge.modal_reduction import reduction
from ambkit.machine.axes import isolated_axes, load_capacity, weights_of
from ambkit.machine.machine import Machine
from ambkit.machine.magnets import ConstantStiffness, magnet_of, own_time
from ambkit.machine.parts import GRAVITY
from ambkit.simulation.scenario import Scenario, by_axis
from ambkit.simulation.waveforms import Waveform

NIS_BAND = (0.25, 4.0)
"""Mean NIS up to which the innovations are within a factor of two of their stated deviation."""

NIS_LIMIT = 25.0
"""Mean NIS above which, or below whose inverse, filter and record do not belong together."""

SAMPLING = (0.25, 0.5)
"""Sampling time over the rotor's time constant: unusual, and too slow to stabilise it."""

PARAMETER_DIFFERENCE = 0.2
"""Relative difference above which a parameter is that of another machine."""

STIFFNESS_FACTOR = 2.0  #: Factor in a stiffness that no operating point explains.
NOISE_FACTOR = 1e3  #: Factor in a noise intensity beyond the range of tuning.

GATES = (3.0, 1.0)
"""Gate, in standard deviations, below which healthy measurements are rejected; and too many."""

STEPS = 50.0
"""Quantisation over the noise's deviation above which an estimate in the loop gains little."""

WEIGHTS = 1e3  #: Load capacity in weights above which mass or magnet is doubtful.


class Finding(NamedTuple):
    """One figure of the judgement."""

    name: str  #: Name of the figure.
    value: float  #: In `unit`.
    unit: str
    limit: float  #: Its limit, in the same unit.
    sentence: str = ""  #: Objection; empty if there is none.
    fatal: bool = False  #: Whether it rules the filter out.


def innovations(nis: float) -> Iterator[Finding]:
    """Yield whether the mean NIS of a record is in its band, if it is known."""
    if math.isnan(nis):
        return
    low, high = NIS_BAND
    limit, text = (high if nis > 1 else low), ""
    if not low <= nis <= high:
        text = (
            f"innovations are {math.sqrt(nis):.2g} times what the filter expects (mean NIS "
            f"{nis:.3g}, consistent from {low:g} to {high:g})"
        )
    yield Finding("mean NIS", nis, "1", limit, text, not 1 / NIS_LIMIT <= nis <= NIS_LIMIT)


def _parameters(b: Machine) -> dict[str, tuple[float, str]]:
    """Return the parameters by which one axis differs from another."""
    return {
        "sampling_time": (b.sampling_time, "s"),
        "rotor.mass": (b.rotor.mass, "kg"),
        "weight along x": (b.weight, "N"),
        "rotor.clearance": (b.clearance, "m"),
        "magnet.magnet_constant": (b.magnet.magnet_constant, "N m^2/A^2"),
        "magnet.air_gap": (b.magnet.air_gap, "m"),
        "magnet.bias_current": (b.magnet.bias_current, "A"),
        "amplifier.gain": (b.amplifier.gain, "A/V"),
        "sensor.gain": (b.sensor.gain, "1"),
    }


def identity(filter: Estimator, plant: Any) -> Iterator[Finding]:
    """Yield the differences between the filter's machine and the one it is used on."""
    own = filter.machine
    if own == plant:
        yield Finding("maximum difference of a parameter", 0.0, "1", PARAMETER_DIFFERENCE)
        return
    names = [([a.name for a in of.axes], [r.name for r in of.readings]) for of in (own, plant)]
    who = f"the filter is of {own.name} (fingerprint {_fingerprint(own)}), not of {plant.name}"
    who = f"{who} (fingerprint {_fingerprint(plant)})"
    if names[0] != names[1]:
        yield Finding("axes", math.inf, "1", 0.0, f"{who}: axes or readings are others", True)
        return
    worst, differ = 0.0, []
    for k, (one, other) in enumerate(zip(isolated_axes(own), isolated_axes(plant), strict=True)):
        axis = f" of {name}" if (name := plant.axes[k].name) else ""
        ours, theirs = _parameters(one), _parameters(other)
        alike = _alike(one, other)
        for name, (value, unit) in ours.items():
            if alike and name.startswith("magnet."):
                continue
            true = theirs[name][0]
            off = abs(value - true) / max(abs(value), abs(true), 1e-300)
            worst = max(worst, off)
            if off > PARAMETER_DIFFERENCE:
                ours_is, is_not = (engineering(v, unit, digits=4) for v in (value, true))
                differ.append(f"{name}{axis} {ours_is}, not {is_not}")
    text = f"{who}: {', '.join(differ[:6])}" if differ else ""
    fatal = bool(differ)
    yield Finding(
        "maximum difference of a parameter", worst, "1", PARAMETER_DIFFERENCE, text, fatal
    )


def _alike(one: Machine, other: Machine) -> bool:
    """Return whether two magnets have the same stiffnesses, all that many logs determine."""
    known = [ConstantStiffness.of(item) for item in (one, other)]
    a, b = (np.array([k.k_i, k.k_s]) for k in known)
    return bool((np.abs(a - b) <= PARAMETER_DIFFERENCE * np.maximum(np.abs(a), np.abs(b))).all())


def _fingerprint(plant: Any) -> str:
    return hashlib.sha256(plant.model_dump_json().encode()).hexdigest()[:6]


def of_machine(plant: Machine) -> Iterator[Finding]:
    """Yield implausible properties of the machine: sampled too slowly, or far too light."""
    T = plant.sampling_time
    fastest_axis = min(isolated_axes(plant), key=own_time)
    share, tau = T / own_time(fastest_axis), own_time(fastest_axis)
    text = ""
    if share > SAMPLING[0]:
        text = (
            f"a sampling time of {engineering(T, 's', digits=3)} is {share:.3g} times the rotor's "
            f"time constant sqrt(m/k_s), {engineering(tau, 's', digits=3)}; the limit is "
            f"{SAMPLING[1]:g}: are sampling_time, mass and magnet right?"
        )
    name = "sampling time over time constant"
    yield Finding(name, share, "1", SAMPLING[1], text, share > SAMPLING[1])
    lifts = [
        load / (b.rotor.mass * GRAVITY)
        for b, load in zip(isolated_axes(plant), load_capacity(plant), strict=True)
    ]
    most, text = max(lifts), ""
    if most > WEIGHTS:
        text = f"the magnet lifts {most:.3g} times the rotor's weight: is rotor.mass right?"
    yield Finding("load capacity over weight", most, "1", WEIGHTS, text)
    yield from _steps(plant)


def modes_kept(plant: Machine) -> Iterator[Finding]:
    """Yield the error of the modal truncation, if it is known."""
    compared = None if plant.bending is None else reduction(plant)
    if compared is not None:
        text = "" if compared.good else compared.text()
        yield Finding("error of the modes kept", compared.error, "1", compared.tolerance, text)


def _steps(plant: Machine) -> Iterator[Finding]:
    sensors = [reading.sensor for reading in plant.readings]
    coarse = max(sensors, key=lambda s: (s.quantisation or 0.0) ** 2 / s.noise_variance)
    step, std = coarse.quantisation or 0.0, math.sqrt(coarse.noise_variance)
    text = ""
    if step > STEPS * std:
        text = (
            f"a quantisation of {engineering(step, 'm', digits=3)} is {step / std:.3g} standard "
            f"deviations of the sensor's noise; beyond {STEPS:g} an estimate that feeds the "
            "controller is hardly better than the measurement: take a finer converter"
        )
    yield Finding("quantisation over noise", step / std, "1", STEPS, text)


def noise(filter: Estimator, plant: Machine) -> Iterator[Finding]:
    """Yield the ratio of a filter's noise parameters to the machine's."""
    usual = View(plant).variances(FilterNoise())
    for name, unit, what, of in (
        ("measurement", "m^2", "measurement noise", "the sensor's"),
        ("control", "V^2", "control noise", "the amplifier's"),
        ("disturbance", "N^2/s", "process noise intensity", "the usual"),
    ):
        ours, theirs = (np.atleast_1d(getattr(v, name)) for v in (filter.variances, usual))
        with np.errstate(divide="ignore"):
            far = np.abs(np.log(ours / theirs))
        k = int(np.argmax(far))
        ratio, text = float(ours[k] / theirs[k]), ""
        if far[k] > math.log(NOISE_FACTOR) + 1e-6:
            text = (
                f"noise.{name}, {engineering(float(ours[k]), unit, digits=3)}, is {ratio:.2g} "
                f"times {of}, {engineering(float(theirs[k]), unit, digits=3)}"
            )
        yield Finding(what, ratio, "1", NOISE_FACTOR, text, bool(text) and name == "measurement")


def settings(filter: Estimator, plant: Machine) -> Iterator[Finding]:
    """Yield the effect of a filter's settings on healthy measurements."""
    gate, text = float(filter.options.get("gate", math.inf)), ""
    lost = math.erfc(gate / math.sqrt(2))
    if gate < GATES[0]:
        text = (
            f"a gate of {gate:.3g} standard deviations rejects {lost:.3g} of healthy measurements"
        )
    yield Finding("gate", gate, "1", GATES[0], text, gate < GATES[1])
    if filter.options.get("as_printed"):
        T = plant.sampling_time
        lag = max(reading.sensor.lag for reading in plant.readings)
        early = (T / -math.expm1(-T / lag) if lag else T) - lag
        text = (
            f"as_printed takes eq. 19 as the paper prints it: estimates lead the rotor by "
            f"{engineering(early, 's', digits=3)}"
        )
        yield Finding("lead of as_printed", early, "s", 0.0, text)


def of_filter(
    filter: Estimator, plant: Machine, control: Any, own_control: bool, fed_back: bool
) -> Iterator[Finding]:
    """Yield the consequences of gain and magnet model: tracking of a disturbance, and margins."""
    if filter.options.get("gravity") == "disturbance" and any(weights_of(plant)):
        weight = max(map(abs, weights_of(plant)))
        text = (
            f"the weight, {engineering(weight, 'N', digits=3)}, is part of the estimated "
            'disturbance force (gravity = "disturbance")'
        )
        yield Finding("weight in the disturbance force", weight, "N", 0.0, text)
    stand_in = settling(filter)
    try:
        yield from _magnet(filter, plant)
        if filter.by_model:
            yield from _follows(stand_in, plant)
        if fed_back:
            yield from _margins(stand_in, plant, control, own_control)
    except AmbkitError as error:
        yield Finding("settled gain", math.nan, "1", math.nan, f"adequacy not judged: {error}")


def _magnet(filter: Estimator, plant: Any) -> Iterator[Finding]:
    """Yield the difference between a filter's magnet model and the machine's."""
    if not filter.by_model:
        return
    point = operating_point(plant)
    ours = np.atleast_2d(np.array(tangents_known(filter.magnet, "tangent", point)).T)
    points = np.atleast_2d(np.array(point[:2]).T)
    theirs = np.array([
        magnet_of(b).tangent(float(iu), float(x))
        for b, (iu, x) in zip(isolated_axes(plant), points, strict=True)
    ])  # fmt: skip
    worst, text = 1.0, ""
    for name, unit, k in (("k_i", "N/A", 0), ("k_s", "N/m", 1)):
        for one, other in zip(ours[:, k].tolist(), theirs[:, k].tolist(), strict=True):
            factor = math.inf if one * other <= 0 else max(one / other, other / one)
            if abs(other) > 0 and factor > worst:
                worst = factor
                if factor > STIFFNESS_FACTOR:
                    known, true = (engineering(v, unit, digits=3) for v in (one, other))
                    text = f"the filter takes the magnet's {name} for {known}, it is {true}"
    yield Finding("factor in a stiffness", worst, "1", STIFFNESS_FACTOR, text, bool(text))


def _follows(filter: Estimator, plant: Any) -> Iterator[Finding]:
    """Yield the response to a step of the stated disturbance, and the noise of the estimate."""
    loads = load_capacity(plant)
    parts = following(filter)
    slow = max(parts, key=lambda one: one.time / one.own)
    step, limit, text = STEP * loads[slow.axis], LONGEST * slow.own, ""
    if slow.time > limit:
        took = "more than " * math.isinf(slow.time) + engineering(
            min(slow.time, 4 * limit), "s", digits=3
        )
        text = (
            f"a disturbance force of {engineering(step, 'N', digits=3)}, {STEP:.0%} of the load "
            f"capacity, is followed to 63 % in {took}; the limit is "
            f"{engineering(limit, 's', digits=3)}, {LONGEST:g} times the rotor's time constant "
            f"sqrt(m/k_s). Meanwhile its position is wrong by up to "
            f"{engineering(step * slow.wrong, 'm', digits=3)}: raise noise.disturbance"
        )
    yield Finding("time to follow a load", slow.time, "s", limit, text, bool(text))
    sensors = np.sqrt(np.max(
        np.atleast_1d(View(plant).variances(FilterNoise()).measurement)
        / np.atleast_1d(filter.variances.measurement)
    ))  # fmt: skip
    loud = max(parts, key=lambda one: one.noise / loads[one.axis])
    rms, most, text = float(loud.noise * sensors), loads[loud.axis], ""
    if rms > STEP * most:
        text = (
            f"the sensor's noise alone moves the estimated force by "
            f"{engineering(rms, 'N', digits=3)} rms, of a load capacity of "
            f"{engineering(most, 'N', digits=3)}: lower noise.disturbance"
        )
    yield Finding("noise of the estimated force", rms, "N", most, text, rms > most)


def _margins(filter: Estimator, plant: Any, control: Any, own_control: bool) -> Iterator[Finding]:
    """Yield the peak of abs(S) of the loop with estimate feedback."""
    peak = loop_peak(plant, filter, control)
    text, fatal, limit = "", False, ZONES[-1][1]
    if peak >= limit or zone_of(peak) == "C":  # not for continuous operation
        whose = "this controller" if own_control else "the default controller"
        text = (
            f"with {whose} the loop is unstable"
            if math.isinf(peak)
            else f"with {whose} the peak of |S| is {peak:.3g}, zone {zone_of(peak)} of ISO 14839-3"
        )
        fatal = peak >= limit
        if fatal and not own_control and loop_peak(plant, KalmanFilter(plant)) >= limit:
            fatal, text = False, f"{text}; with the default filter too: the controller is at fault"
            with suppress(AmbkitError):  # no such regulator
                if (lqg := loop_peak(plant, filter, Control(type="lqg"))) < peak:
                    text += f'; type = "lqg" in [controller] has {lqg:.3g}'
    yield Finding("peak of |S|", peak, "1", limit, text, fatal)


def loop_peak(plant: Any, filter: Estimator, control: Any = None) -> float:
    """Return the peak of abs(S) of the axes [1], infinite if the loop is unstable."""
    of = LoopBuilder(plant, control, point=operating_point(plant))
    loop = of.loop(filter)
    # A pole on the unit circle belongs to states that a filter cannot distinguish, as unbalance and
    # runout at constant speed: it does not grow.
    return math.inf if loop.closed.unstable().size else float(axis_peaks(loop, of.top).max())


def demands(plant: Any, scenario: Scenario) -> Iterator[Finding]:
    """Yield displacement and force of a run against their limits."""
    names = plant.axis_names
    for axis, b, load in zip(names, isolated_axes(plant), load_capacity(plant), strict=True):
        position, force = (
            [signal for name, signal in by_axis(scenario, what, names[0]) if name == axis]
            for what in ("reference", "disturbance")
        )
        where = f" of {axis}" if axis else ""
        for what, item, most, unit in (
            ("reference", position, b.clearance, "m"),
            ("disturbance force", force, load, "N"),
        ):
            far = _greatest(item, scenario.duration)
            text = ""
            if far > most:
                limit = "clearance" if unit == "m" else "load capacity"
                text = (
                    f"the {what}{where} reaches {engineering(far, unit, digits=3)}, beyond the "
                    f"{limit} of {engineering(most, unit, digits=3)}"
                )
            yield Finding(f"{what}{where}", far, unit, most, text)


def _greatest(signals: Sequence[Waveform], duration: float) -> float:
    """Return the maximum magnitude of a sum of signals over a run."""
    if not signals:
        return 0.0
    t = np.linspace(0.0, duration, 2001)
    return float(np.abs(sum(signal.sample(t) for signal in signals)).max())
