"""Filters along a record, with warnings."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from typing import Any

import numpy as np

from ambkit.arguments import (
    arguments_of_the_user,
    check_plausibility,
    machine_argument,
    record_argument,
)
from ambkit.base.errors import AmbkitError
from ambkit.base.quantity_arguments import in_si, names_in
from ambkit.base.units import figure, percent
from ambkit.control.control import WITH_CURRENT
from ambkit.data.channel_map import ChannelMap
from ambkit.data.reading.plausibility import longest_run
from ambkit.data.record import Record
from ambkit.data.signals import signal, values_of
from ambkit.estimate.angle import angle_notes
from ambkit.estimate.estimate import Estimate
from ambkit.estimate.estimator import Estimator
from ambkit.estimate.filter_file import FilterFile
from ambkit.estimate.named import Factory, FromFile, FromObject, factories
from ambkit.estimate.noise_model import FilterNoise
from ambkit.estimate.registry import FILTER_SUFFIX
from ambkit.estimate.status import Status
from ambkit.fuzzy.expert import Expert
from ambkit.judge.adequacy import judge_adequacy, sentences
from ambkit.judge.contact import contact_notes
from ambkit.judge.evaluation import Evaluation, evaluate
from ambkit.judge.unbalance import unbalance_notes
from ambkit.machine.axes import isolated_axes, models_of
from ambkit.machine.machine import Machine
from ambkit.rotordynamics.harmonics import harmonics
from ambkit.workflow.filter import HORIZONS, Filtered, Filtering, Stretch, TunedNoise
from ambkit.workflow.tuning import (
    check_signals,
    default_disturbance,
    log_likelihood,
    tune_disturbance,
)

OUTSIDE = 0.01
"""An expert that is asked outside of its box in more than this part of the samples is noted."""
AUTO = "auto"  #: Tune the process noise intensity of the disturbance force.


def filtered(
    record: Any, filters: Any, machine: Any, channels: Any, window: Any, *, settling: Any,
    measurement: Any, disturbance: Any, smooth: bool, done: Callable[[str], None],
) -> Filtering:  # fmt: skip
    """Run filters along a record, with warnings."""
    several = (
        filters.values()
        if isinstance(filters, Mapping)
        else names_in(Estimator, type, filter=() if filters is None else filters)
    )
    texts = [os.fspath(item) for item in several if isinstance(item, str | os.PathLike)]
    files = {name: FilterFile.load(name) for name in texts if name.endswith(FILTER_SUFFIX)}
    if machine is None and not files:
        raise AmbkitError("machine is missing: a preset's name, or a TOML file")
    plant = next(iter(files.values())).plant if machine is None else machine_argument(machine)
    log = record_argument(record, _channels(files, channels), window)
    remarks = check_plausibility(log, plant, "the record" if isinstance(record, Record) else record)
    tune, intensity = _disturbance(disturbance)
    built = factories(filters, plant)
    noise = FilterNoise(measurement=in_si("measurement_noise", measurement, "m^2"),
                        disturbance=intensity)  # fmt: skip
    check_signals(plant, log)
    with arguments_of_the_user():
        result = _along(plant, log, built, noise, tune, in_si("settling", settling, "s"),
                        smooth=smooth, done=done)  # fmt: skip
    stretch = result.stretch
    if stretch is not None and stretch.by_itself:
        start, stop = (log.t[0] + end for end in (stretch.start, stretch.stop))
        names = [name for name in built if (tuning := result[name].tuning) and tuning.kept]
        whose = "" if len(names) == len(built) else f" ({', '.join(names)})"
        remarks.append(
            f"Tuned from {start:.3g} to {stop:.3g} s{whose}, judged on the rest." if names
            else f"Judged from {stop:.3g} s on."
        )  # fmt: skip
    adequacy = {
        name: judge_adequacy(
            build() if isinstance(build := built[name], FromFile) else None, plant,
            nis=one.evaluation.nis,
        )
        for name, one in result.estimators.items()
    }  # fmt: skip
    for name, one in result.estimators.items():
        remarks += [*_of_tuning(one), *(f"{name}: {text}" for text in sentences(adequacy[name]))]
    if any(item.sentence for of in adequacy.values() for item in of if item.name == "mean NIS"):
        remarks.append("Are units, signs and machine those of this record?")
    estimates = {name: one.evaluation.estimate for name, one in result.estimators.items()}
    remarks += [*angle_notes(plant, log, estimates), *_warnings(result, len(log), estimates)]
    source = str(record) if isinstance(record, str | os.PathLike) else ""
    return replace(result, source=source, adequacy=adequacy, remarks=remarks)


def _along(
    machine: Machine, record: Record, built: Mapping[str, Factory], noise: FilterNoise,
    tune: float | None, settling: float, *, smooth: bool, done: Callable[[str], None],
) -> Filtering:  # fmt: skip
    """Run filters along a record and evaluate them."""
    begin, end = levitated(record)
    until, record = record.between(stop=end), record.between(begin, end)
    # A filter file determines the machine and noise of its filter.
    fixed = {name for name, build in built.items() if isinstance(build, FromFile | FromObject)}
    tunes = noise.disturbance is None and (tune is not None or fixed < {*built})
    stretch = tuning_window(record, tune) if tunes else None
    late = max(settling, stretch.stop if stretch else 0.0)
    results = {}
    for name, build in built.items():
        own, part = noise, stretch
        if name in fixed:
            variances = getattr(build(), "variances", None)
            own, part = noise if variances is None else FilterNoise(*variances), None
        estimator, one = _filtered(name, build, record, own, part, late)
        results[name] = replace(
            one,
            outside=outside_operating_range(estimator, one.evaluation.estimate, record),
            turning=harmonics(estimator, until),
            smoothed=build(one.noise).smooth(record) if smooth else None,
        )
        done(name)
    return Filtering(machine, record, stretch, late, results)


def tuning_window(record: Record, tune: float | None = None) -> Stretch | None:
    """Return the part for tuning: the requested one, or the second quarter of a measured record."""
    # The first quarter is often a start. By default nothing is tuned if the truth is known.
    span = float(record.t[-1] - record.t[0])
    if tune is None:
        return None if record.has_truth else Stretch(span / 4, span / 2, by_itself=True)
    if not tune < span:
        raise AmbkitError(
            f"tune must be shorter than the record, {span:.4g} s, and leave time for validation; "
            f"is {tune:g} s"
        )
    return Stretch(0.0, tune, by_itself=False)


def _filtered(
    name: str, build: Factory, record: Record, noise: FilterNoise, stretch: Stretch | None,
    settling: float,
) -> tuple[Estimator, Filtered]:  # fmt: skip
    """Return the result of an estimator with its own or tuned noise."""

    def evaluated(assumed: FilterNoise) -> tuple[Estimator, Evaluation]:
        estimator = build(assumed)
        return estimator, evaluate(estimator, record, horizons=HORIZONS, settling=settling)

    if stretch is None:
        estimator, evaluation = evaluated(noise)
        return estimator, Filtered(name, noise, evaluation)
    part = record.between(record.t[0] + stretch.start, record.t[0] + stretch.stop)
    machine = build().machine
    tuned = tune_disturbance(machine, part, lambda Q: build(replace(noise, disturbance=Q)))
    likeliest, untuned = (
        replace(noise, disturbance=Q) for Q in (tuned.intensity, default_disturbance(machine))
    )
    with_tuned, without = evaluated(likeliest), evaluated(untuned)
    worse = _less_likely(with_tuned[1], without[1])
    kept = not (worse and stretch.by_itself)
    assumed, (estimator, evaluation) = (likeliest, with_tuned) if kept else (untuned, without)
    tuning = TunedNoise(likeliest, untuned, tuned.why, worse, kept)
    return estimator, Filtered(name, assumed, evaluation, tuning)


def _less_likely(one: Evaluation, other: Evaluation) -> bool:
    """Return whether one estimate makes the measurements that both use less likely than another."""
    samples = one.estimate.t.size
    counts = (one.estimate.used | other.estimate.used) & (
        np.arange(samples) >= samples - one.samples
    )
    less, more = (log_likelihood(e.estimate, counts=counts) for e in (one, other))
    return less < more


def levitated(record: Record) -> tuple[float | None, float | None]:
    """Return start and end of levitation in a record of lift-off and landing [s]."""
    # Before and after, contact forces act and the magnets are off, which no estimator models. None
    # and None: a record without ``mode``, or without lift-off.
    if "mode" not in record:
        return None, None
    on = np.flatnonzero(np.isin(record["mode"], WITH_CURRENT))
    if len(on) < 3:
        return None, None
    end = int(on[-1]) + 1
    return float(record.t[on[0]]), float(record.t[end]) if end < len(record) else None


def _disturbance(value: Any) -> tuple[float | None, float | None]:
    """Return the initial time for tuning [s] and the intensity [N^2/s]; None if not stated."""
    if isinstance(value, str) and value.partition(" ")[0] == AUTO:
        time = value.partition(" ")[2].strip()
        tune = in_si("disturbance_noise", time, "s") if time else None
        if tune is not None and not tune > 0:
            raise AmbkitError(f"disturbance_noise must be tuned on more than 0 s, is {value!r}")
        return tune, None
    return None, in_si("disturbance_noise", value, "N^2/s")


def _channels(files: Mapping[str, FilterFile], channels: Any) -> ChannelMap | None:
    """Return the channel map, with y and u as in the filter files."""
    if channels is None:
        return None
    known = channels if isinstance(channels, ChannelMap) else ChannelMap.load(channels)
    inputs = {name: file.inputs for name, file in files.items() if not file.inputs.in_si}
    if not inputs:
        return known
    first, *others = inputs
    for name in others:
        if inputs[name] != inputs[first]:
            raise AmbkitError(f"{first} and {name} read other inputs: filter by one at a time")
    return known.with_inputs(inputs[first])


def _of_tuning(one: Filtered) -> Iterator[str]:
    """Yield what the tuning leaves open, and whether the rest of the record contradicts it."""
    tuning = one.tuning
    if tuning is None:
        return
    if tuning.why and tuning.kept:
        yield f"{one.name}: {tuning.why}"
    if tuning.worse:
        then = (
            "so the tuning is doubtful"
            if tuning.kept
            else "so the untuned one is used; this choice is not independent of the record"
        )
        yield (
            f"{one.name}: tuned disturbance noise, {tuning.tuned.disturbance:.3g} N^2/s, fits the "
            f"rest of the record worse than the untuned, {tuning.untuned.disturbance:.3g} N^2/s "
            f"(the disturbance force varied differently there), {then}; --disturbance-noise sets "
            "it, or tunes it on another interval"
        )


def _warnings(result: Filtering, samples: int, estimates: Mapping[str, Estimate]) -> Iterator[str]:
    """Yield mismatches of filter and record, and missing signals."""
    left = samples - len(result.record)
    if left:
        yield f"{left} samples are excluded: the mode of the record is off there"
    lost, in_a_row = missing_control(result.record)
    if lost:
        yield (
            f"the control signal is missing in {lost} of {len(result.record)} samples, at most "
            f"{in_a_row} in a row: the filters hold the last one, and are overconfident there"
        )
    yield from unbalance_notes(result.machine, result.record, estimates)
    yield from contact_notes(result.machine, result.record, estimates)
    gap = max(placed.magnet.air_gap for placed in result.machine.bearings)
    for name, one in result.estimators.items():
        if any(max(values_of(e)) > gap for e in one.evaluation.prediction.values()):
            yield (
                f"{name}: predicts beyond the air gap, {figure(gap, 'm', 4)}: the "
                "model does not hold over so long a time; the rotor is in contact or held in "
                "part of the record, or is of another rig ('ambkit check' with --machine)"
            )
        beyond = np.mean((one.evaluation.estimate.status & np.uint16(Status.OUTSIDE)) != 0)
        if beyond:
            yield (
                f"{name}: the magnet constant is beyond all of its models in {percent(beyond)} of "
                "the samples, and the stated errors are too small there: choose other scales, or "
                "identify the magnet"
            )
        for axis, outside in one.outside.items():
            yield f"{name}, axis {axis}: {outside}" if axis else f"{name}: {outside}"


def missing_control(record: Record) -> tuple[int, int]:
    """Return the number of samples without control signal, and the longest gap."""
    # The true input is unknown then: filters hold the last value, and understate their error for a
    # while.
    controls = [record[n] for n in record if n.partition("_")[0] == "u"]
    lost = np.any(~np.isfinite(controls), axis=0)
    if not lost.any():
        return 0, 0
    return int(lost.sum()), longest_run(lost)[1]


def outside_operating_range(
    estimator: Estimator, estimate: Estimate, record: Record
) -> dict[str, str]:
    """Return by axis, in words, the operation outside the expert's training range, if relevant."""
    machine, results = estimator.machine, {}
    parts = zip(machine.axes, models_of(estimator.magnet), isolated_axes(machine), strict=True)
    for axis, expert, b in parts:
        if not isinstance(expert, Expert):
            continue
        current = np.clip(
            b.amplifier.gain * record[signal("u", axis.name)], b.current_min, b.current_max
        )
        x = np.asarray(sum(form * estimate[q] for q, form in axis.line.form.items()))
        beyond, texts = np.zeros(len(x), bool), []
        for what, values, (low, high), unit in (
            ("current", current, expert.current_range, "A"),
            ("displacement", x, expert.displacement_range, "m"),
        ):
            slack = 1e-9 * (high - low)  # of rounding at the ends; missing samples do not count
            out = (values < low - slack) | (values > high + slack)
            ends = f"{figure(low, unit, 3)} to {figure(high, unit, 3)}"
            texts.append(f"{what} {ends} ({percent(out.mean())})")
            beyond |= out
        if beyond.mean() > OUTSIDE:
            results[axis.name] = (
                f"{percent(beyond.mean())} of the samples lie outside the range of the expert, "
                f"{', '.join(texts)}; there it gives the values at the edge: train it on a larger "
                "range ('ambkit train --reach')"
            )
    return results
