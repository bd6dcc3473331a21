"""Filters that a user names along a record: what goes in, and what is to be said of it."""

from __future__ import annotations

import os
from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from typing import Any

from ambkit.assessment.arguments import (
    arguments_of_the_user,
    check_plausibility,
    machine_argument,
    record_argument,
)
from ambkit.base.errors import AmbkitError, RecordError
from ambkit.base.quantity_arguments import in_si, names_in
from ambkit.base.units import figure, percent
from ambkit.data.channel_map import ChannelMap
from ambkit.data.record import Record
from ambkit.data.signals import each_of
from ambkit.estimate.angle import estimate_angle
from ambkit.estimate.estimator import Estimator
from ambkit.estimate.filter_file import FilterFile
from ambkit.estimate.named import FromFile, factories
from ambkit.estimate.noise_model import FilterNoise
from ambkit.estimate.registry import FILTER_SUFFIX
from ambkit.judge.adequacy import judge_adequacy, sentences
from ambkit.judge.contact import contact_notes
from ambkit.machine.machine import Machine
from ambkit.workflow.filter import Filtered, Filtering, filter
from ambkit.workflow.warnings import OutsideOperatingRange, missing_control

AUTO = "auto"  #: Tune the intensity of the disturbance force.


def filtered(
    record: Any, filters: Any, machine: Any, channels: Any, window: Any, *, settling: Any,
    measurement: Any, disturbance: Any, smooth: bool, done: Callable[[str], None],
) -> Filtering:  # fmt: skip
    """Run the filters that a user names along a record, with remarks."""
    several = (
        filters.values()
        if isinstance(filters, Mapping)
        else names_in(Estimator, type, filter=filters)
    )
    texts = [os.fspath(item) for item in several if isinstance(item, str | os.PathLike)]
    files = {name: FilterFile.load(name) for name in texts if name.endswith(FILTER_SUFFIX)}
    if machine is None and not files:
        raise AmbkitError("machine is missing: a preset's name, or a TOML file")
    plant = next(iter(files.values())).plant if machine is None else machine_argument(machine)
    log = record_argument(record, _channels(files, channels), window)
    name = "the record" if hasattr(record, "signals") else record
    try:
        remarks = [f"{name}: {text}" for text in check_plausibility(log, plant)]
    except RecordError as error:
        raise RecordError([f"{name}: {problem}" for problem in error.problems]) from None
    tune, intensity = _disturbance(disturbance)
    built = factories(filters, plant)
    noise = FilterNoise(measurement=in_si("measurement_noise", measurement, "m^2"),
                        disturbance=intensity)  # fmt: skip
    with arguments_of_the_user():
        result = filter(
            plant, log, built, noise=noise, tune=tune, settling=settling, smooth=smooth,
            done=lambda one: done(one.name),
        )  # fmt: skip
    stretch = result.stretch
    if stretch is not None and stretch.by_itself:
        start, stop = (log.t[0] + end for end in (stretch.start, stretch.stop))
        names = [name for name in built if result[name].tuning is not None]
        whose = "" if len(names) == len(built) else f" ({', '.join(names)})"
        remarks.append(f"Tuned from {start:.3g} to {stop:.3g} s{whose}, judged on the rest.")
    adequacy = {
        name: judge_adequacy(
            build() if isinstance(build := built[name], FromFile) else None, plant,
            nis=one.evaluation.nis,
        )
        for name, one in result.estimators.items()
    }  # fmt: skip
    for name, one in result.estimators.items():
        remarks += [*_of_tuning(one), *(f"{name}: {text}" for text in sentences(adequacy[name]))]
    remarks += [*_of_angle(plant, log), *_warnings(result, len(log))]
    source = str(record) if isinstance(record, str | os.PathLike) else ""
    return replace(result, source=source, adequacy=adequacy, remarks=remarks)


def _disturbance(value: Any) -> tuple[float | None, float | None]:
    """Return the time at the start to tune on [s], and the intensity [N^2/s]; None: not given."""
    if isinstance(value, str) and value.partition(" ")[0] == AUTO:
        time = value.partition(" ")[2].strip()
        tune = in_si("disturbance_noise", time, "s") if time else None
        if tune is not None and not tune > 0:
            raise AmbkitError(f"disturbance_noise must be tuned on more than 0 s, is {value!r}")
        return tune, None
    return None, in_si("disturbance_noise", value, "N^2/s")


def _channels(files: Mapping[str, FilterFile], channels: Any) -> ChannelMap | None:
    """Return the map of the log, with y and u as the filters' files have them."""
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


def _of_angle(machine: Machine, record: Record) -> Iterator[str]:
    """Yield for how long the rotor's angle is not known."""
    if machine.angle is not None and (lost := estimate_angle(machine, record).lost).any():
        yield (
            f"the rotor's angle is lost in {percent(lost.mean())} of the samples, last at "
            f"{record.t[lost][-1]:.4g} s: unbalance control is off there"
        )


def _of_tuning(one: Filtered) -> Iterator[str]:
    """Yield what the stretch leaves open, and whether the rest of the record contradicts it."""
    tuning = one.tuning
    if tuning is None:
        return
    if tuning.why:
        yield f"{one.name}: {tuning.why}"
    if tuning.worse:
        then = (
            "so doubt the tuning first"
            if tuning.kept
            else "so the untuned one is used; this choice has seen the record that judges it"
        )
        yield (
            f"{one.name}: tuned disturbance noise, {tuning.found.disturbance:.3g} N^2/s, fits the "
            f"rest of the record worse than the untuned, {tuning.untuned.disturbance:.3g} N^2/s "
            f"(the force moved otherwise there), {then}; --disturbance-noise sets it, or tunes it "
            "on another stretch"
        )


def _warnings(result: Filtering, samples: int) -> Iterator[str]:
    """Yield where filter and record do not belong together, or where signals are missing."""
    left = samples - len(result.record)
    if left:
        yield f"{left} samples are excluded: the mode of the record is off there"
    lost, in_a_row = missing_control(result.record)
    if lost:
        yield (
            f"the control signal is missing in {lost} of {len(result.record)} samples, at most "
            f"{in_a_row} in a row: the filters hold the last one, and are overconfident there"
        )
    estimates = {name: one.evaluation.estimate for name, one in result.estimators.items()}
    yield from contact_notes(result.machine, result.record, estimates)
    gap = max(placed.magnet.air_gap for placed in result.machine.bearings)
    for name, one in result.estimators.items():
        if any(max(each_of(e)) > gap for e in one.evaluation.prediction.values()):
            yield (
                f"{name}: predicts beyond the air gap, {figure(gap, 'm', 4)}: the "
                "model does not hold over so long a time; the rotor is in contact or held in "
                "part of the record, or is of another rig ('ambkit check' with --machine)"
            )
        if one.outermost is not None:
            yield (
                f"{name}: takes the outermost of its models, {one.outermost:g} times the magnet "
                "constant, for true: the magnet may be beyond them, and the stated errors are too "
                "small then; give others by scales, or identify the magnet"
            )
        for axis, outside in one.outside.items():
            yield _of_the_box(f"{name}, axis {axis}" if axis else name, outside)


def _of_the_box(name: str, outside: OutsideOperatingRange) -> str:
    """Return how far an expert is queried beyond the box that it was trained for."""
    current, displacement = (
        f"{figure(low, unit, 3)} to {figure(high, unit, 3)} ({percent(share)})"
        for (low, high, share), unit in ((outside.current, "A"), (outside.displacement, "m"))
    )
    return (
        f"{name}: {percent(outside.share)} of the samples lie outside the range of the "
        f"expert, current {current}, displacement {displacement}; there it gives the values at the "
        "edge: train it on a larger range ('ambkit train --reach')"
    )
